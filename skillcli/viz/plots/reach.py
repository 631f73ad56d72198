"""Figures of the reach task. Maps are drawn as seen by the robot: y grows to the left."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skillcli.viz import motion, panels_space
from skillcli.viz.canvas import WIDTH, blank, legend, mark, skill_handles
from skillcli.viz.scene import Scene

ABOVE, FRONT = (1, 0), (1, 2)  # y and x; y and z
TITLES = {ABOVE: "from above", FRONT: "from behind the robot"}


def skill_paths(source: Scene, target: Scene | None = None) -> Figure:
    """Gripper paths of every skill, in the source and, where they were tried, on each target domain (paper figure 4).

    Args:
        source: of a pretrain or embed-means artifact.
        target: of a transfer-eval artifact of bare skills.
    """
    domains = {} if target is None else {name: of for name, of in motion.domains(target).items() if name != "nominal"}
    drawn = blank(WIDTH, 2.1 + 1.6 * len(domains))
    rows = drawn.subplots(1 + len(domains), 2, squeeze=False)
    for axes, plane in zip(rows[0], (ABOVE, FRONT), strict=True):
        panels_space.paths(axes, source, plane)
        _finish(axes, source, plane, "source")
    for row, (name, episodes) in zip(rows[1:], domains.items(), strict=True):
        assert target is not None
        for axes, plane in zip(row, (ABOVE, FRONT), strict=True):
            panels_space.executed(axes, target, plane, episodes)
            _finish(axes, target, plane, f"{name}, n = {len(episodes)}")
            panels_space.goals(axes, target, plane)
    for axes, plane in zip(rows[0], (ABOVE, FRONT), strict=True):
        panels_space.goals(axes, source, plane)
    marks = [mark("start", "o", "white"), *([mark("success", "o"), mark("failure", "X", "white")] if domains else [])]
    names = [(skill, f"skill {panels_space.numbered(source, skill)}") for skill in range(len(source.skills))]
    legend(drawn, [*skill_handles(names), *marks])
    return drawn


def compositions(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """Executed compositions side by side, from above and from behind the robot (paper figure 5).

    Args:
        scenes: of compose artifacts.
        titles: one for each.
    """
    drawn = blank(WIDTH, 3.4 if len(scenes) > 1 else 2.4)
    single = len(scenes) == 1
    grid = drawn.subplots(1, 2, squeeze=False).T if single else drawn.subplots(2, len(scenes), squeeze=False)
    for column, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        for axes, plane in zip(grid[:, column], (ABOVE, FRONT), strict=True):
            panels_space.executed(axes, scene, plane, list(range(scene.trajectories.episodes)))
            named = title if plane == ABOVE or single else ""
            _finish(axes, scene, plane, f"{named}, {TITLES[plane]}" if single else named or TITLES[FRONT], name_plane=False)
            panels_space.waypoints(axes, scene, plane)
    fed = sorted({skill for scene in scenes for skill in panels_space.fed_skills(scene)}, key=lambda k: (k < 0, k))
    names = [(k, "between skills" if k < 0 else f"skill {panels_space.numbered(scenes[0], k)}") for k in fed]
    marks = [
        mark("start", "o", "white"),
        mark("success", "o"),
        mark("failure", "X", "white"),
        mark("goal of a skill", "+", size=6),
    ]
    legend(drawn, [*skill_handles(names), *marks])
    return drawn


def _finish(axes: Axes, scene: Scene, plane: tuple[int, int], title: str, name_plane: bool = True) -> None:
    """Turn a map as the robot sees it, and say what it is."""
    axes.invert_xaxis()
    axes.set_title(f"{title}, {TITLES[plane]}" if name_plane else title)
