"""Facts about recorded motion that figures and recordings need, computed from the arrays alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skillcli.metrics import final_distance, ordered_approach, ordered_moments
from skillcli.trajectories import Array
from skillcli.viz.palette import Look, latent_look
from skillcli.viz.scene import Runs, Scene

MAX_PLAYED = 8  # episodes shown moving; more make a recording long, not clearer
MAX_TRANSFERRED = 20  # the same over all domains of a transfer, but at least one each
SAME = 1e-6  # m: episodes of a domain whose ends are nearer than this count as one


class Piece(NamedTuple):
    """Control steps `start` to `stop` of an episode with one skill (-1: latents that are no skill's mean)."""

    start: int
    stop: int
    skill: int


def piece_look(scene: Scene, episode: int, piece: Piece) -> Look:
    """Return the style of a piece by its latent half-way: a blend has the colours of both its ends."""
    return latent_look(piece.skill, scene.trajectories.latent[episode, (piece.start + piece.stop) // 2], scene.means)


def domain(label: str) -> str:
    """Return the domain in an episode's label: "real-like 4" is of "real-like"."""
    return label.rpartition(" ")[0] or label


def domains(scene: Scene) -> dict[str, list[int]]:
    """Group episodes by domain, both in order of appearance."""
    groups: dict[str, list[int]] = {}
    for episode, label in enumerate(scene.episode_labels):
        groups.setdefault(domain(label), []).append(episode)
    return groups


def episode_skill(scene: Scene, episode: int) -> int:
    """Return the skill of an episode: the one it was conditioned on, or the one whose goal it had if its latent was sampled."""
    fed = int(scene.trajectories.skill[episode, 0]) if scene.trajectories.skill.shape[1] else -1
    if fed >= 0 or not len(scene.goals):
        return fed
    gaps = np.linalg.norm(scene.goals - scene.trajectories.target[episode], axis=-1)  # (K,)
    nearest = int(gaps.argmin())
    return nearest if gaps[nearest] <= scene.tolerance else -1


def mean_episodes(scene: Scene) -> dict[int, int]:
    """Map each skill to the first episode at its mean latent, if there is one."""
    fed = scene.trajectories.skill[:, 0] if scene.trajectories.skill.shape[1] else np.empty(0)
    found: dict[int, int] = {}
    for episode, skill in enumerate(fed):
        if skill >= 0:
            found.setdefault(int(skill), episode)
    return dict(sorted(found.items()))


def path(scene: Scene, episode: int) -> Array:
    """Return the path of the achieved goal over the episode, (length+1, 3) m."""
    moved: Array = scene.trajectories.achieved_goal[episode, : int(scene.trajectories.length[episode]) + 1]
    return moved


def pieces(scene: Scene, episode: int) -> list[Piece]:
    """Split the episode where the latent changes; a latent that changes at every step (a blend) is one piece."""
    length = int(scene.trajectories.length[episode])
    skill, latent = scene.trajectories.skill[episode, :length], scene.trajectories.latent[episode, :length]
    if scene.runs.held:
        return [Piece(0, length, episode_skill(scene, episode))]
    changed = (np.diff(skill) != 0) | np.any(np.diff(latent, axis=0) != 0, axis=-1)
    cuts = [0, *(np.flatnonzero(changed) + 1).tolist(), length]
    merged: list[Piece] = []
    for start, stop in pairwise(cuts):
        piece = Piece(start, stop, int(skill[start])) if length else Piece(0, 0, -1)
        if merged and _blends(merged[-1], skill, latent) and _blends(piece, skill, latent):
            piece = Piece(merged.pop().start, stop, -1)
        merged.append(piece)
    return merged


def _blends(piece: Piece, skill: Array, latent: Array) -> bool:
    """Return whether the latent moves at every step of the piece, as in a blend between skills."""
    if piece.skill >= 0:
        return False
    rows = latent[piece.start : piece.stop]
    return len(rows) == 1 or bool(np.any(np.diff(rows, axis=0) != 0, axis=-1).all())


def passed(moved: Array, waypoints: Array, tolerance: float) -> Array:
    """Count the waypoints passed in order before each row of a path, by the same rule as success.

    Args:
        moved: (n, 2) or (n, 3) m.
        waypoints: (W, 2) or (W, 3) m.
        tolerance: m.

    Returns:
        (n+1,) int; the last is the total.
    """
    moments, gaps = ordered_moments(moved, waypoints, tolerance)
    in_order = np.logical_and.accumulate(gaps <= tolerance)
    counts: Array = np.searchsorted(moments[in_order], np.arange(len(moved) + 1))
    return counts


def due_in(scene: Scene, episode: int) -> Array:
    """Return the waypoints of an episode in order, (W, 3) m."""
    found: Array = scene.waypoints[scene.waypoint_route == scene.episode_route[episode]]
    return found


def distance(scene: Scene, episode: int) -> Array:
    """Return the distance to the next waypoint, or without waypoints to the target, (length+1,) m."""
    moved, waypoints, target = path(scene, episode), due_in(scene, episode), scene.trajectories.target[episode]
    if len(waypoints):
        order = passed(moved, waypoints, scene.tolerance)[:-1]
        target = waypoints[np.minimum(order, len(waypoints) - 1)]
    gap: Array = np.linalg.norm(moved - target, axis=-1)
    return gap


def off_plan(scene: Scene, episode: int) -> Array:
    """Return how far an executed episode is from where its plan is at that time, (length+1,) m."""
    assert scene.source is not None, "there is no plan to compare with"
    route = int(scene.episode_source[episode])
    way = scene.source.achieved_goal[route, : int(scene.source.length[route]) + 1]
    moved, last = path(scene, episode), len(way) - 1
    due = np.minimum(np.round(np.arange(len(moved)) * scene.pace).astype(int), last)
    gap: Array = np.linalg.norm(moved - way[due], axis=-1)
    return gap


def closest(scene: Scene, episode: int) -> Array:
    """Return the smallest distance to each waypoint in its turn, (W,) m, as in the results of the composition."""
    return ordered_approach(path(scene, episode), due_in(scene, episode), scene.tolerance)


def reached(scene: Scene, episode: int) -> Array:
    """Return the share of waypoints passed so far, or without them whether the target is within tolerance, (length+1,)."""
    moved, waypoints = path(scene, episode), due_in(scene, episode)
    if not len(waypoints):
        within: Array = (distance(scene, episode) <= scene.tolerance).astype(float)
        return within
    share: Array = passed(moved, waypoints, scene.tolerance)[1:] / len(waypoints)
    return share


def played(scene: Scene) -> list[int]:
    """Choose the episodes to show moving: each skill at its mean, or some of each domain from worst to best, or the first.

    The domain with the worst end comes first, and in it the worst episode.
    """
    if scene.runs.held and (at_means := list(mean_episodes(scene).values())):
        return at_means[:MAX_PLAYED]
    if scene.runs is not Runs.DOMAINS:
        return list(range(min(scene.trajectories.episodes, MAX_PLAYED)))
    groups, gaps = domains(scene), final_distance(scene.trajectories)
    each = max(1, MAX_TRANSFERRED // max(1, len(groups)))
    worst_first = sorted(groups.values(), key=lambda episodes: -gaps[episodes].max())
    return [episode for episodes in worst_first for episode in spanning(episodes, gaps, each)]


def spanning(episodes: list[int], gaps: Array, count: int) -> list[int]:
    """Choose the three worst episodes, a middle one and the best, worst first; fewer if fewer are asked for or differ.

    Args:
        episodes: to choose from.
        gaps: (E,) m, final distances of all episodes.
        count: at most so many.
    """
    ordered = sorted(episodes, key=lambda episode: -gaps[episode])
    distinct = ordered[:1] + [b for a, b in pairwise(ordered) if gaps[a] - gaps[b] > SAME]
    last = len(distinct) - 1
    by_weight = list(dict.fromkeys(min(rank, last) for rank in (0, last, (last + 1) // 2, 1, 2)))
    return [distinct[rank] for rank in sorted(by_weight[:count])]


def sent(scene: Scene) -> Scene | None:
    """Make a scene of what a transfer sent to its robots, one episode per route or skill; None if it is unknown."""
    if scene.source is None:
        return None
    episodes = scene.source.episodes
    routes = np.arange(episodes) % (int(scene.waypoint_route.max(initial=0)) + 1)
    return replace(
        scene,
        runs=Runs.PLANNED,
        trajectories=scene.source,
        model=scene.source_model or scene.model,
        joints=scene.source_joints or scene.joints,
        other_robot="",
        source_model=None,
        episode_route=routes,
        episode_labels=tuple(f"sent {episode}" for episode in range(episodes)),
        source=None,
        parameters={},
    )
