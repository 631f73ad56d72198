"""Subplots of paths in space and of skills in the latent space."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Ellipse

from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.palette import BETWEEN, TARGET, look
from skillcli.viz.scene import Runs, Scene

Plane = tuple[int, int]  # indices of the two coordinates to draw

_ALPHA = {1: 0.25, 2: 0.12}  # of the ellipse at so many standard deviations
_NAMES = ("x", "y", "z")
_HALO = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}


def planes(scene: Scene) -> list[Plane]:
    """Return the projections of this task."""
    return list(scene.figure_settings.planes)


def latent_planes(scene: Scene) -> list[Plane]:
    """Return the projections of the latent space, at most two."""
    return [(0, 1), (0, 2)] if scene.means.shape[-1] >= 3 else [(0, 1)]


def numbered(scene: Scene, skill: int) -> str:
    """Return the skill's number, as at its goal, and its name."""
    name, number = scene.skills[skill], str(skill + 1)
    return name if name.split()[-1:] == [number] else f"{number}  {name}"


def skills_in_use(scene: Scene) -> list[int]:
    """Return the skills that occur in the episodes, -1 (between skills) last."""
    used = {piece.skill for e in range(scene.trajectories.episodes) for piece in motion.pieces(scene, e)}
    return sorted(used, key=lambda skill: (skill < 0, skill))


def limits(scene: Scene, plane: Plane) -> tuple[Array, Array]:
    """Return lower and upper corner of a projection, (2,) m each, from limits common to all projections."""
    reach = scene.tolerance
    ways = [motion.path(scene, episode) for episode in range(scene.trajectories.episodes)]
    ways += [hand for episode in motion.played(scene) if (hand := _hand(scene, episode)) is not None]
    fed = [skill for skill in skills_in_use(scene) if skill >= 0]
    spots = np.concatenate([scene.waypoints, scene.goals if not len(scene.waypoints) else scene.goals[fed]])
    points = np.concatenate([spots - reach, spots + reach, *ways])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.08 * float((high - low).max())
    axes = list(plane)
    return low[axes] - margin, high[axes] + margin


def _hand(scene: Scene, episode: int) -> Array | None:
    """Return the gripper's path if something else is compared with the goal, (length+1, 3) m."""
    data = scene.trajectories
    if data.object_pose is None or data.gripper_position is None:
        return None
    moved: Array = data.gripper_position[episode, : int(data.length[episode]) + 1]
    return moved


def _frame(axes: Axes, scene: Scene, plane: Plane) -> None:
    """Set equal scales, limits and axis names of a map."""
    low, high = limits(scene, plane)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel=f"{_NAMES[plane[0]]} [m]", ylabel=f"{_NAMES[plane[1]]} [m]")
    axes.grid(True)
    spans = high - low
    longest = max(float(np.max(np.subtract(*limits(scene, other)[::-1]))) for other in planes(scene))  # of maps side by side
    axes.locator_params(axis="x", nbins=5 if spans[0] > 0.7 * longest else 3)
    axes.locator_params(axis="y", nbins=5 if spans[1] > 0.7 * longest else 3)


def paths(axes: Axes, scene: Scene, plane: Plane) -> None:
    """Draw every episode in the style of its skill: mean latents bold, sampled latents thin."""
    bold, data = motion.mean_episodes(scene), scene.trajectories
    rest = [episode for episode in range(data.episodes) if episode not in bold.values()]
    if scene.runs is Runs.BETWEEN:
        _between(axes, scene, plane, rest)
        rest = []
    # one collection: hundreds of separate lines take seconds to lay out
    ways = [motion.path(scene, episode)[:, plane] for episode in rest]
    colors = [look(motion.episode_skill(scene, episode)).color for episode in rest]
    axes.add_collection(LineCollection(ways, colors=colors, linewidths=0.5, alpha=0.35, rasterized=True))
    for skill, episode in bold.items():
        style, moved = look(skill), motion.path(scene, episode)[:, plane]
        if (hand := _hand(scene, episode)) is not None:
            axes.plot(*hand[:, plane].T, color=BETWEEN, lw=0.5, zorder=2)
        axes.plot(*moved.T, color=style.color, ls=style.dash, zorder=3)
        axes.plot(*moved[-1], color=style.color, marker=style.marker, ms=4, zorder=4)
        axes.plot(*moved[0], color="black", marker="o", mfc="white", ms=4, zorder=5)
    _frame(axes, scene, plane)
    axes.set_title(f"{scene.figure_settings.achieved} paths from above" if plane == (0, 1) else "from the side")


def _between(axes: Axes, scene: Scene, plane: Plane, episodes: list[int]) -> None:
    """Draw the ends of episodes between skills, each with a thin line to half-way between the two goals."""
    for episode in episodes:
        moved, wanted = motion.path(scene, episode)[:, plane], scene.trajectories.target[episode, list(plane)]
        axes.plot(*moved.T, color=TARGET, ls=(0, (1, 1)), lw=1.1, zorder=3)
        axes.plot(*moved[-1], color=TARGET, marker="D", ms=3.5, zorder=4)
        axes.plot(*wanted, color=TARGET, marker="x", ms=5, zorder=4)
        axes.plot(*np.stack([moved[-1], wanted]).T, color=TARGET, lw=0.4, zorder=2)


def map_ends(axes: Axes, scene: Scene, plane: Plane, on_robots: bool = False) -> None:
    """Where the latents of the map end, each joined to the place between the goals that it is for.

    Args:
        axes: drawn into.
        scene: with a map.
        plane: its axes.
        on_robots: each on another robot, instead of the nominal one.
    """
    there = scene.map_ends_on_robots if on_robots else scene.map_ends
    wanted, ends = scene.map_places[:, plane], there[:, plane]
    axes.add_collection(LineCollection(list(np.stack([wanted, ends], axis=1)), colors=TARGET, linewidths=0.6))
    axes.plot(*ends.T, color=TARGET, ls="none", marker=".", ms=2.5, zorder=3)
    for skill, spot in enumerate(scene.goals[:, plane]):
        axes.plot(*spot, color=look(skill).color, marker="+", ms=6, mew=1.2, zorder=4)
    axes.margins(0.06)
    axes.set(xlabel=f"{_NAMES[plane[0]]} [m]", ylabel=f"{_NAMES[plane[1]]} [m]", aspect="equal")
    axes.grid(True)
    off = np.quantile(np.linalg.norm(there - scene.map_places, axis=1), 0.95)
    unit, scale = scene.figure_settings.unit
    what = "robots" if on_robots else "map"
    axes.set_title(f"{what}, 95 %: {scale * off:.1f} {unit}" if plane == (0, 1) else "from the side")


def goals(axes: Axes, scene: Scene, plane: Plane) -> None:
    """Draw numbered goals with their tolerance; goals at one spot of this projection share a label."""
    for members in coincident(scene.goals[:, plane], scene.tolerance / 2):
        spot = scene.goals[members[0], list(plane)]
        for skill in members:
            axes.add_patch(Circle(tuple(spot), scene.tolerance, fill=False, ec=look(skill).color, lw=0.8, zorder=2))
        _label(axes, spot, scene.tolerance, ", ".join(str(skill + 1) for skill in members))


def waypoints(axes: Axes, scene: Scene, plane: Plane) -> None:
    """Draw the waypoints with their tolerance, numbered in order; without waypoints the goals, numbered as skills."""
    spots = scene.waypoints if len(scene.waypoints) else scene.goals
    for members in coincident(spots[:, plane], scene.tolerance / 2):
        spot = spots[members[0], list(plane)]
        axes.add_patch(Circle(tuple(spot), scene.tolerance, fc=TARGET, ec="none", alpha=0.1, zorder=1))
        axes.add_patch(Circle(tuple(spot), scene.tolerance, fill=False, ec=TARGET, lw=0.8, zorder=2))
        _label(axes, spot, scene.tolerance, ", ".join(str(index + 1) for index in members))


def _label(axes: Axes, spot: Array, radius: float, text: str) -> None:
    """Write a label outside a circle, away from the middle of the map, where no paths are."""
    middle = np.array([np.mean(axes.get_xlim()), np.mean(axes.get_ylim())])
    away = spot - middle
    away = away / np.linalg.norm(away) if np.linalg.norm(away) > 1e-9 else np.array([0.0, 1.0])
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    place = spot + away * radius * 1.15
    clear = bool(np.all(place > low + 0.02 * (high - low)) and np.all(place < high - 0.02 * (high - low)))
    place = place if clear else spot - away * radius * 1.15
    outward = away if clear else -away
    axes.annotate(
        text,
        (float(place[0]), float(place[1])),
        xytext=(float(5 * outward[0]), float(5 * outward[1])),
        textcoords="offset points",
        ha="center",
        va="center",
        zorder=6,
        bbox=_HALO,
        annotation_clip=False,
    )


def coincident(spots: Array, within: float) -> list[list[int]]:
    """Group indices of nearby spots, (n, 2) m; a spot joins the first group whose first member is near."""
    found: list[list[int]] = []
    for index, spot in enumerate(spots):
        for members in found:
            if np.linalg.norm(spots[members[0]] - spot) <= within:
                members.append(index)
                break
        else:
            found.append([index])
    return found


VIOLATION = "v"  # marker where an episode first violates a safety limit


def executed(axes: Axes, scene: Scene, plane: Plane, episodes: list[int]) -> None:
    """Draw executed paths, each piece in the style of its skill, whose goal is a cross; a single path is bold."""
    single, beyond = scene.runs is Runs.PLANNED, scene.trajectories.first_violations
    for skill in skills_in_use(scene):
        if skill >= 0:
            axes.plot(*scene.goals[skill, list(plane)], color=look(skill).color, marker="+", ms=6, mew=1.2, zorder=2)
    for episode in episodes:
        moved = motion.path(scene, episode)[:, plane]
        if (hand := _hand(scene, episode)) is not None:
            axes.plot(*hand[:, plane].T, color=BETWEEN, lw=0.4, alpha=0.6, zorder=2, rasterized=not single)
        for piece in motion.pieces(scene, episode):
            style, part = motion.piece_look(scene, episode, piece), moved[piece.start : piece.stop + 1]
            axes.plot(
                *part.T,
                color=style.color,
                ls=style.dash,
                lw=1.6 if single else 0.8,
                alpha=1.0 if single else 0.6,
                zorder=3,
            )
        success = bool(scene.trajectories.success[episode])
        end, filling = ("o", "black") if success else ("X", "white")
        axes.plot(*moved[0], color="black", marker="o", mfc="white", ms=4, mew=0.8, zorder=5)
        axes.plot(*moved[-1], color="black", marker=end, mfc=filling, ms=4, mew=0.8, zorder=5)
        for step in beyond[episode].values():
            axes.plot(*moved[step + 1], color="black", marker=VIOLATION, mfc="white", ms=5, mew=0.8, zorder=6)
    for line in axes.lines:
        line.set_in_layout(False)  # it is inside the axes, and laying out hundreds takes seconds
    _frame(axes, scene, plane)
    axes.set_title("executed, from above" if plane == (0, 1) else "from the side")


def planned(axes: Axes, scene: Scene, plane: Plane) -> None:
    """Draw the paths that were planned, dotted, beside the executed ones."""
    sent = motion.sent(scene)
    for episode in range(sent.trajectories.episodes if sent else 0):
        assert sent is not None
        axes.plot(*motion.path(sent, episode)[:, plane].T, color=TARGET, ls=":", lw=1.1, zorder=4)
    axes.set_title("executed (dotted: planned)" if plane == (0, 1) else "from the side")


def latents(axes: Axes, scene: Scene, plane: Plane, route: int | None = None) -> None:
    """Draw means with ellipses of standard deviations, and the latents of an episode in order.

    Args:
        axes: where to draw.
        scene: what to draw.
        plane: the two components; a missing component is zero.
        route: the episode whose latents are joined by a line.
    """
    means, stds = components(scene.means, plane), components(scene.stds, plane)
    for members in coincident(means, float(stds.mean()) if len(stds) else 0.0):
        spot, text = means[members[0]], ", ".join(str(skill + 1) for skill in members)
        axes.annotate(text, (spot[0], spot[1]), xytext=(6, 6), textcoords="offset points", zorder=6, bbox=_HALO)
    for skill, (mean, std) in enumerate(zip(means, stds, strict=True)):
        style = look(skill)
        for scale, alpha in ((n, _ALPHA[n]) for n in sorted(scene.figure_settings.latent_sigmas, reverse=True)):
            width, height = 2 * scale * std
            axes.add_patch(Ellipse(tuple(mean), width, height, fc=style.color, ec="none", alpha=alpha, zorder=1))
        axes.add_patch(Ellipse(tuple(mean), *(2 * std), fill=False, ec=style.color, ls=style.dash, lw=0.9, zorder=2))
        axes.plot(*mean, color=style.color, marker=style.marker, ms=4, zorder=4)
    if route is not None:
        fed = components(scene.trajectories.latent[route, : int(scene.trajectories.length[route])], plane)
        axes.plot(*fed.T, color=TARGET, lw=0.9, marker=".", ms=3, zorder=3)
    axes.margins(0.12)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"$z_{plane[0] + 1}$", ylabel=f"$z_{plane[1] + 1}$")
    axes.grid(True)
    what = " and ".join(rf"{n}$\sigma$" for n in sorted(scene.figure_settings.latent_sigmas))
    axes.set_title(f"latent space ({what})" if route is None else "the plan in latent space")


def components(latent: Array, plane: Plane) -> Array:
    """Return two components of latents, (n, d) → (n, 2)."""
    return np.stack([latent[:, i] if i < latent.shape[-1] else np.zeros(len(latent)) for i in plane], axis=-1)
