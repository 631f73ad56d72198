"""Figures of the reach task. Maps are drawn from the robot's view: y grows to the left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from skillcli.trajectories import Array
from skillcli.viz import motion, subplots_space
from skillcli.viz.figure_style import WIDTH, blank, legend, mark, skill_handles
from skillcli.viz.palette import TARGET
from skillcli.viz.scene import Scene

ABOVE, BEHIND = (1, 0), (1, 2)  # y and x; y and z
PLANES = (ABOVE, BEHIND)
TITLES = {ABOVE: "from above", BEHIND: "from behind"}


def skill_paths(source: Scene, target: Scene | None = None) -> Figure:
    """Draw gripper paths of every skill, in the source and on each target domain, if there are any (paper figure 4).

    Args:
        source: of a pretrain or embed-means artifact.
        target: of a transfer-eval artifact of bare skills.
    """
    domains = {} if target is None else {name: of for name, of in motion.domains(target).items() if name != "nominal"}
    figure = blank(WIDTH, 2.7 + 1.95 * len(domains))
    rows = figure.subplots(1 + len(domains), 2, squeeze=False)
    for axes, plane in zip(rows[0], PLANES, strict=True):
        subplots_space.paths(axes, source, plane)
        _finish(axes, source, plane, source.goals, f"source, {TITLES[plane]}")
    for row, (name, episodes) in zip(rows[1:], domains.items(), strict=True):
        for axes, plane in zip(row, PLANES, strict=True):
            assert target is not None
            subplots_space.executed(axes, target, plane, episodes)
            _finish(axes, target, plane, target.goals, f"{name} (n = {len(episodes)}), {TITLES[plane]}")
    marks = [mark("start", "o", "white"), *([mark("success", "o"), mark("failure", "X", "white")] if domains else [])]
    names = [(skill, f"skill {subplots_space.numbered(source, skill)}") for skill in range(len(source.skills))]
    legend(figure, [*skill_handles(names), *marks])
    return figure


def compositions(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """Draw executed compositions, one per row, from above and from behind the robot (paper figure 5).

    Args:
        scenes: of compose artifacts.
        titles: one for each.
    """
    figure = blank(WIDTH, 0.9 + 1.95 * len(scenes))
    grid = figure.subplots(len(scenes), 2, squeeze=False)
    for row, scene, title in zip(grid, scenes, titles, strict=True):
        for axes, plane in zip(row, PLANES, strict=True):
            subplots_space.executed(axes, scene, plane, list(range(scene.trajectories.episodes)))
            _finish(axes, scene, plane, scene.waypoints, f"{title}, {TITLES[plane]}")
    fed = sorted({skill for scene in scenes for skill in subplots_space.skills_in_use(scene)}, key=lambda k: (k < 0, k))
    names = [(k, "between (mixed)" if k < 0 else f"skill {subplots_space.numbered(scenes[0], k)}") for k in fed]
    marks = [
        mark("start", "o", "white"),
        mark("success", "o"),
        mark("failure", "X", "white"),
        mark("goal of skill", "+", size=6),
    ]
    legend(figure, [*skill_handles(names, marked=False), *marks])
    return figure


def _finish(axes: Axes, scene: Scene, plane: tuple[int, int], spots: Array, title: str) -> None:
    """Number the spots, draw their tolerance, turn the map to the robot's view, and title it."""
    middle = float(np.mean(axes.get_ylim()))
    for members in subplots_space.coincident(spots[:, plane], scene.tolerance / 2):
        across, up = spots[members[0], list(plane)].tolist()
        axes.add_patch(Circle((across, up), scene.tolerance, fc="#00000010", ec=TARGET, lw=0.7, zorder=1))
        side = 1 if up >= middle else -1  # away from the middle, where the paths are
        axes.annotate(
            ", ".join(str(index + 1) for index in members),
            (across, up + side * scene.tolerance),
            xytext=(0, 2 * side),
            textcoords="offset points",
            ha="center",
            va="bottom" if side > 0 else "top",
            fontsize=7,
        )
    low, high = axes.get_ylim()
    room = 0.05 * (high - low)
    axes.set_ylim(low - room, high + room)
    axes.invert_xaxis()
    axes.set_title(title)
