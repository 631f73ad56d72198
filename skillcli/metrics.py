"""Definitions of the reported numbers, as pure functions over numpy arrays."""

from __future__ import annotations

import math

import numpy as np

from skillcli.trajectories import Array, Trajectories


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Compute Wilson's score interval of a success rate (Wilson 1927), 95 % by default; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    scale = 1.0 + z * z / trials
    centre = (rate + z * z / (2 * trials)) / scale
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials)) / scale
    return max(0.0, centre - half), min(1.0, centre + half)


def difference_interval(
    rate_a: float, interval_a: tuple[float, float], rate_b: float, interval_b: tuple[float, float]
) -> tuple[float, float]:
    """Compute Newcombe's hybrid score interval of a difference of independent rates, a - b (Newcombe 1998, method 10).

    Args:
        rate_a: measured.
        interval_a: Wilson's; of an exact rate, an interval without width.
        rate_b: measured.
        interval_b: Wilson's.
    """
    (low_a, high_a), (low_b, high_b) = interval_a, interval_b
    difference = rate_a - rate_b
    return difference - math.hypot(rate_a - low_a, high_b - rate_b), difference + math.hypot(high_a - rate_a, rate_b - low_b)


def final_distance(trajectories: Trajectories) -> Array:
    """Compute the distance of the achieved goal to the target at the end of each episode, (E,) m."""
    episodes = np.arange(trajectories.episodes)
    end = trajectories.achieved_goal[episodes, trajectories.length]
    distance: Array = np.linalg.norm(end - trajectories.target, axis=1)
    return distance


def final_yaw(trajectories: Trajectories) -> Array | None:
    """Compute how far the object was turned about the vertical from start to end, (E,) degrees in (-180, 180].

    Counter-clockwise as seen from above; None without an object.
    """
    if trajectories.object_pose is None:
        return None
    episodes = np.arange(trajectories.episodes)
    start, end = trajectories.object_pose[:, 0, 3:], trajectories.object_pose[episodes, trajectories.length, 3:]
    turned = np.degrees(yaw(end) - yaw(start))
    wrapped: Array = 180.0 - (180.0 - turned) % 360.0
    return wrapped


def yaw(quaternion: Array) -> Array:
    """Compute the heading of a body's x axis as seen from above, (..., 4) w x y z to (...,) rad."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=float), -1, 0)
    heading: Array = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return heading


def distance_summary(distance: Array) -> dict[str, float]:
    """Compute mean, median, quartiles, 10th and 90th percentile of distances (E,), m."""
    quantiles = {"p10": 0.1, "p25": 0.25, "median": 0.5, "p75": 0.75, "p90": 0.9}
    return {"mean": float(distance.mean()), **{name: float(np.quantile(distance, q)) for name, q in quantiles.items()}}


def pairwise_distance(points: Array) -> Array:
    """Compute Euclidean distances between all rows, (K, d) to (K, K)."""
    distance: Array = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return distance


def neighbours(points: Array) -> list[tuple[int, int]]:
    """List pairs (a, b), a < b, of points with no other point in or on the ball between them (Gabriel and Sokal 1969).

    Of the corners of a box these are its edges, of four places around a centre the four sides and not the diagonals.
    """
    pairs = []
    for a in range(len(points)):
        for b in range(a + 1, len(points)):
            centre, radius = (points[a] + points[b]) / 2, np.linalg.norm(points[a] - points[b]) / 2
            others = np.delete(points, [a, b], axis=0)
            if (np.linalg.norm(others - centre, axis=1) > radius * (1 + 1e-9)).all():
                pairs.append((a, b))
    return pairs


def angle_deg(a: Array, b: Array) -> float | None:
    """Compute the angle between two vectors, degrees; None if one of them is zero."""
    lengths = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(a @ b / lengths, -1.0, 1.0)))) if lengths > 0 else None


def distance_correlation(latents: Array, goals: Array) -> float | None:
    """Compute Pearson's r of the pairwise distances between latents and between goals; None if it is undefined."""
    upper = np.triu_indices(len(latents), 1)
    a, b = pairwise_distance(latents)[upper], pairwise_distance(goals)[upper]
    if len(a) < 2 or np.ptp(a) < 1e-12 or np.ptp(b) < 1e-12:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def embedding_efficiency(mean: Array, std: Array) -> float | None:
    """Divide the summed volume of the one-sigma ellipsoids by the volume of the means' convex hull; lower is better separated.

    None if the hull has no volume: fewer than d + 1 skills, or means in one plane.
    """
    skills, size = mean.shape
    if skills <= size:
        return None
    unit_ball = math.pi ** (size / 2) / math.gamma(size / 2 + 1)
    ellipsoids = float(unit_ball * std.prod(axis=1).sum())
    if size == 1:
        hull = float(np.ptp(mean))
    else:
        from scipy.spatial import ConvexHull, QhullError  # slow to import, and only needed here

        try:
            hull = float(ConvexHull(mean).volume)
        except QhullError:
            return None
    return ellipsoids / hull if hull > 0 else None


def most_likely_skill(latent: Array, mean: Array, std: Array) -> Array:
    """Return the skill with the highest density p(z|t) at each latent: (..., d), (K, d), (K, d) to (...,) index."""
    standard = (latent[..., None, :] - mean) / std
    log_density = -0.5 * np.square(standard).sum(-1) - np.log(std).sum(-1)
    skill: Array = log_density.argmax(-1)
    return skill


def next_waypoint(index: Array | int, place: Array, waypoints: Array, tolerance: float, keep_last: bool = False) -> Array:
    """Return the index of the next waypoint after a further place of a path.

    A waypoint is met within the tolerance, in its turn; one place may meet several. `ordered_approach` is the same rule for a
    finished path: it is within the tolerance everywhere exactly if this rule meets every waypoint.

    Args:
        index: (...,) of the next waypoint so far.
        place: (..., 3) m.
        waypoints: (W, 3) m.
        tolerance: m.
        keep_last: keep the last one as the next, for a stricter rule: low speed, or all robots near.

    Returns:
        (...,) indices; W where every waypoint is met.
    """
    following, end = np.array(index), len(waypoints) - keep_last
    while (unmet := following < end).any():
        gap = np.linalg.norm(place - waypoints[np.minimum(following, len(waypoints) - 1)], axis=-1)
        met = unmet & (gap <= tolerance)
        if not met.any():
            break
        following = following + met
    return following


def ordered_approach(path: Array, waypoints: Array, tolerance: float) -> Array:
    """Return the distances at which a path passes waypoints in order, (W,) m; see `ordered_moments`."""
    return ordered_moments(path, waypoints, tolerance)[1]


MISSED = 1e6  # m, more than any sum of distances: meeting one more waypoint always counts first


def ordered_moments(path: Array, waypoints: Array, tolerance: float) -> tuple[Array, Array]:
    """Find when a path is closest to waypoints that must be met in order, and how close.

    Each waypoint gets one moment, the moments in the order of the waypoints (dynamic programming over time): as many as
    possible within the tolerance, and then the smallest sum of distances. All are within the tolerance exactly if the path
    meets them in order.

    Args:
        path: (T, 3) m.
        waypoints: (W, 3) m.
        tolerance: m.

    Returns:
        Rows of the path (W,), and distances there (W,) m.
    """
    distance = np.linalg.norm(path[None] - waypoints[:, None], axis=-1)  # (W, T)
    smallest: Array = np.zeros(len(path))  # sum of distances up to here, with a moment for every waypoint so far
    moments = []
    for row in distance:
        total = smallest + row + np.where(row > tolerance, MISSED, 0.0)
        smallest = np.minimum.accumulate(total)
        moments.append(np.maximum.accumulate(np.where(total <= smallest, np.arange(len(path)), 0)))
    moment, chosen = len(path) - 1, np.empty(len(waypoints), dtype=int)
    for w in range(len(waypoints) - 1, -1, -1):
        chosen[w] = moment = int(moments[w][moment])
    return chosen, distance[np.arange(len(waypoints)), chosen]


RETREAT = 0.01  # of the way between two goals: a motion that goes back by less counts as monotone


def interpolation_calibration(end: Array, goal_a: Array, goal_b: Array, share: Array) -> dict[str, float | bool]:
    """Measure how closely latents (1-λ) z_a + λ z_b, held, lead to the fraction λ of the way between two goals.

    f is the end projected on the line from goal a (0) to goal b (1). The error at one λ is |f - λ|, along the line alone; the
    distance from the line is `off_line_m`.

    Args:
        end: (S, 3) m, where the motion ends.
        goal_a: (3,) m.
        goal_b: (3,) m.
        share: (S,) λ, increasing, from 0 to 1.

    Returns:
        error: mean |f - λ|; error_at_half: |f - λ| at λ = ½, interpolated if ½ is not among them; monotone: f never falls by
        more than `RETREAT` from one λ to the next; off_line_m: mean distance from the line, m.
    """
    way = goal_b - goal_a
    fraction = (end - goal_a) @ way / (way @ way)
    off_line = np.linalg.norm(end - goal_a - fraction[:, None] * way, axis=1)
    return {
        "error": float(np.abs(fraction - share).mean()),
        "error_at_half": float(abs(np.interp(0.5, share, fraction) - 0.5)),
        "monotone": bool((np.diff(fraction) >= -RETREAT).all()),
        "off_line_m": float(off_line.mean()),
    }
