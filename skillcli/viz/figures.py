"""One figure per artifact, drawn without a viewer and without a window.

`figure` is the entry: it draws what `FIGURES` has for the artifact's kind, and writes the file. The panels are
in `panels_space` (paths and latents), `panels_time` (what changes) and `panels_transfer` (domains compared).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D

from skillcli.errors import UsageError
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL, ByKind
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array
from skillcli.viz import motion, panels_space, panels_time, panels_transfer
from skillcli.viz.canvas import blank, encoded, legend, mark, skill_handles, styled
from skillcli.viz.files import FORMATS, replacing
from skillcli.viz.palette import BETWEEN, TARGET
from skillcli.viz.plots.robot import draw_robot
from skillcli.viz.scene import Runs, Scene, drawable

MAX_COLUMNS = 4  # domains beside one another

FIGURES: ByKind[Callable[[Figure, Scene], None]] = ByKind("figure")


def figure(scene: Scene, path: Path) -> None:
    """Draw the scene and write it as PNG, PDF or SVG, by the suffix of `path`.

    Args:
        scene: what to draw.
        path: the file to write; nothing is left there when writing fails.

    Raises:
        UsageError: the suffix is none of the three.
        SkillError: the file cannot be written.
    """
    with replacing(path) as (temporary,):
        temporary.write_bytes(image(scene, path))


def image(scene: Scene, path: Path) -> bytes:
    """What `figure` writes.

    Raises:
        UsageError: the suffix of `path` is none of the three.
    """
    with styled():
        return encoded(draw(drawable(scene)), format_of(path))


def robot_figure(robot: Robot, start: tuple[float, ...], goals: Array, path: Path) -> None:
    """Draw an arm at a start (n,) rad, with goals (K, 3) m, and write it as `figure` does.

    Raises:
        UsageError: the suffix is none of the three.
        SkillError: the file cannot be written.
    """
    suffix = format_of(path)
    with replacing(path) as (temporary,), styled():
        temporary.write_bytes(encoded(draw_robot(robot, start, goals), suffix))


def format_of(path: Path) -> str:
    """The format that the suffix of a path names.

    Raises:
        UsageError: it is none of `FORMATS`.
    """
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise UsageError(f"cannot draw a figure as {path.name!r}", f"end its name in {', '.join(FORMATS)}")
    return suffix


def draw(scene: Scene) -> Figure:
    """The figure of a scene, not yet written."""
    compose = FIGURES.of(scene.kind)
    drawn = blank(10.5, 6.0)
    compose(drawn, scene)
    return drawn


# --- compositions -----------------------------------------------------------------------------------------------------


@FIGURES.register(PRETRAIN, EMBED_MEANS)
def _learned(drawn: Figure, scene: Scene) -> None:
    """Skills: their paths, their place in the latent space, their accuracy, and how they were learned."""
    curves = panels_time.curve_panels(scene)[:3]
    drawn.set_size_inches(10.5, 6.0 if curves else 4.2)
    maps, right = _columns(drawn, scene)
    for axes, plane in _maps(drawn, maps, scene):
        panels_space.paths(axes, scene, plane)
        panels_space.goals(axes, scene, plane)
    rows = right.subgridspec(2 if curves else 1, 6)
    planes = panels_space.latent_planes(scene)
    upper = _split(drawn, rows, 0, len(planes) + 1)
    for axes, plane in zip(upper, planes, strict=False):
        panels_space.latents(axes, scene, plane)
    panels_time.distances(upper[-1], scene)
    if curves:
        for axes, panel in zip(_split(drawn, rows, 1, len(curves)), curves, strict=True):
            panel(axes, scene)
    _head(drawn, scene)
    _skill_legend(drawn, scene, range(len(scene.skills)))


@FIGURES.register(COMPOSE)
def _composed(drawn: Figure, scene: Scene) -> None:
    """A plan as it was executed: in space, in the latent space and over time."""
    drawn.set_size_inches(10.5, 5.6)
    maps, right = _columns(drawn, scene)
    for axes, plane in _maps(drawn, maps, scene):
        panels_space.executed(axes, scene, plane, list(range(scene.trajectories.episodes)))
        panels_space.waypoints(axes, scene, plane)
    grid = right.subgridspec(2, 2, width_ratios=[3, 2])
    above, below = drawn.add_subplot(grid[0, 0]), drawn.add_subplot(grid[1, 0])
    panels_time.latent_components(above, scene, 0)
    panels_time.due_distance(below, scene, 0)
    above.sharex(below)
    above.tick_params(labelbottom=False)
    place = grid[0, 1] if len(scene.waypoints) else grid[:, 1]
    panels_space.latents(drawn.add_subplot(place), scene, (0, 1), route=0)
    if len(scene.waypoints):
        panels_time.closest(drawn.add_subplot(grid[1, 1]), scene)
    _head(drawn, scene)
    _skill_legend(drawn, scene, panels_space.fed_skills(scene))


@FIGURES.register(TRANSFER_EVAL)
def _transferred(drawn: Figure, scene: Scene) -> None:
    """Domains compared: every path, the success with its interval, and the final distances."""
    names = list(motion.domains(scene))
    columns = min(len(names), MAX_COLUMNS)
    rows = -(-len(names) // columns)
    low, high = panels_space.limits(scene, (0, 1))
    width = 10.5
    height = np.clip(width / columns * (high - low)[1] / (high - low)[0], 2.2, 3.6)
    drawn.set_size_inches(width, rows * height + 3.4)
    outer = drawn.add_gridspec(2, 1, height_ratios=[rows * height, 2.8])
    grid = outer[0].subgridspec(rows, columns)
    for place, (name, episodes) in enumerate(motion.domains(scene).items()):
        axes = drawn.add_subplot(grid[place // columns, place % columns])
        panels_space.executed(axes, scene, (0, 1), episodes)
        panels_space.waypoints(axes, scene, (0, 1))
        panels_transfer.entitle(axes, scene, name, episodes)
    lower = outer[1].subgridspec(1, 2)
    panels_transfer.success(drawn.add_subplot(lower[0]), scene)
    panels_transfer.final_distances(drawn.add_subplot(lower[1]), scene)
    _head(drawn, scene)
    _skill_legend(drawn, scene, panels_space.fed_skills(scene))


# --- shared parts -----------------------------------------------------------------------------------------------------


def _columns(drawn: Figure, scene: Scene) -> tuple[SubplotSpec, SubplotSpec]:
    """The maps' column, as wide as their shape asks for, and the rest of the figure."""
    width, height = drawn.get_size_inches()
    spans = [high - low for low, high in (panels_space.limits(scene, plane) for plane in panels_space.planes(scene))]
    wanted = 0.85 * height * spans[0][0] / sum(span[1] for span in spans)
    share = float(np.clip(wanted, 0.22 * width, 0.42 * width)) / width
    grid: GridSpec = drawn.add_gridspec(1, 2, width_ratios=[share, 1 - share])
    return grid[0], grid[1]


def _maps(drawn: Figure, place: SubplotSpec, scene: Scene) -> list[tuple[Axes, tuple[int, int]]]:
    """One axes per projection, above one another, heights in proportion to what they show."""
    planes = panels_space.planes(scene)
    spans = [float(np.ptp(panels_space.limits(scene, plane), axis=0)[1]) for plane in planes]
    grid = place.subgridspec(len(planes), 1, height_ratios=spans)
    return [(drawn.add_subplot(grid[row, 0]), plane) for row, plane in enumerate(planes)]


def _split(drawn: Figure, grid: Any, row: int, count: int) -> list[Axes]:
    """Panels of equal width in a row of six columns."""
    each = 6 // count
    return [drawn.add_subplot(grid[row, i * each : (i + 1) * each]) for i in range(count)]


def _head(drawn: Figure, scene: Scene) -> None:
    """The artifact's id, and what was counted."""
    episodes, at_means = scene.trajectories.episodes, len(motion.mean_episodes(scene))
    counted = f"{episodes} episode" + ("s" if episodes != 1 else "")
    if scene.runs.held:
        sampled = episodes - at_means
        others = "sampled latents" if scene.runs is Runs.SAMPLED else "means of two neighbours"
        counted = f"{at_means} skills at their mean latents" + (f", {sampled} {others}" if sampled else "")
    elif scene.runs is Runs.PLANNED and episodes > 1:
        counted += f", over time: {scene.episode_labels[0]}"
    drawn.suptitle(f"{scene.title}   (n = {counted})", x=0.01, ha="left", fontsize=9.5, fontweight="bold")


def _skill_legend(drawn: Figure, scene: Scene, skills: range | list[int]) -> None:
    """Number, name and look of the skills in use, and the marks of an execution, below everything."""
    names = ["between (mixed)" if skill < 0 else panels_space.numbered(scene, skill) for skill in skills]
    handles: list[Artist] = [*skill_handles(zip(skills, names, strict=True))]
    if not scene.runs.held:
        handles += [mark("start", "o", "white"), mark("success", "o"), mark("failure", "X", "white")]
        handles += [mark("goal of a skill", "+", size=6)]
        if any(scene.trajectories.first_violations):
            handles.append(mark("first beyond a safety limit", panels_space.BREAKS, "white", size=5))
    if scene.runs is Runs.BETWEEN and scene.trajectories.episodes > len(scene.skills):
        handles.append(Line2D([], [], color=TARGET, ls=":", marker="D", ms=3.5, label="mean of two neighbours"))
        handles.append(mark("half-way between their goals", "x", size=5))
    if scene.trajectories.object_pose is not None and scene.trajectories.gripper_position is not None:
        handles.append(Line2D([], [], color=BETWEEN, lw=0.6, label="gripper"))
    legend(drawn, handles, width=150)
