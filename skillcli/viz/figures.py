"""One figure per artifact, without a viewer or a window.

`figure` is the entry: it draws what `FIGURES` lists for the artifact's kind, and writes the file. The subplots are in
`subplots_space` (paths and latents), `subplots_time` (changes over time) and `subplots_transfer` (domains compared).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D

from skillcli.errors import UsageError
from skillcli.files import replacing
from skillcli.kinds import COMPOSE, EMBED_MEANS, EXECUTION, PLAY, PRETRAIN, TRANSFER_EVAL, ByKind
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array
from skillcli.viz import motion, subplots_space, subplots_time, subplots_transfer
from skillcli.viz.figure_style import blank, encoded, legend, mark, skill_handles, styled
from skillcli.viz.formats import FORMATS
from skillcli.viz.palette import BETWEEN, TARGET
from skillcli.viz.paper_figures.robot import draw_robot
from skillcli.viz.scene import Runs, Scene, drawable

MAX_COLUMNS = 4  # domains side by side

FIGURES: ByKind[Callable[[Figure, Scene], None]] = ByKind("figure")


def figure(scene: Scene, path: Path) -> None:
    """Draw the scene and write it as PNG, PDF or SVG, by the suffix of `path`.

    Args:
        scene: what to draw.
        path: the file to write; on failure nothing is left there.

    Raises:
        UsageError: the suffix is none of the three.
        SkillError: the file cannot be written.
    """
    with replacing(path) as (temporary,):
        temporary.write_bytes(image(scene, path))


def image(scene: Scene, path: Path) -> bytes:
    """Return the bytes that `figure` writes.

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
    """Draw the figure of a scene without writing it."""
    compose = FIGURES.of(scene.kind)
    figure = blank(10.5, 6.0)
    compose(figure, scene)
    return figure


# --- compositions -----------------------------------------------------------------------------------------------------


@FIGURES.register(PRETRAIN, EMBED_MEANS)
def _learned(figure: Figure, scene: Scene) -> None:
    """Draw skills: paths, places in the latent space, accuracy, and learning curves or what the map is worth."""
    below = subplots_time.curve_subplots(scene)[:3]
    if len(scene.map_places):
        below = [partial(subplots_space.map_ends, plane=plane) for plane in subplots_space.planes(scene)]
        if len(scene.map_ends_on_robots):
            below.append(partial(subplots_space.map_ends, plane=subplots_space.planes(scene)[0], on_robots=True))
    figure.set_size_inches(10.5, 6.0 if below else 4.2)
    maps, right = _columns(figure, scene)
    for axes, plane in _maps(figure, maps, scene):
        subplots_space.paths(axes, scene, plane)
        subplots_space.goals(axes, scene, plane)
    rows = right.subgridspec(2 if below else 1, 6)
    planes = subplots_space.latent_planes(scene)
    upper = _split(figure, rows, 0, len(planes) + 1)
    for axes, plane in zip(upper, planes, strict=False):
        subplots_space.latents(axes, scene, plane)
    subplots_time.distances(upper[-1], scene)
    if below:
        for axes, panel in zip(_split(figure, rows, 1, len(below)), below, strict=True):
            panel(axes, scene)
    _head(figure, scene)
    _skill_legend(figure, scene, range(len(scene.skills)))


@FIGURES.register(COMPOSE, PLAY)
def _composed(figure: Figure, scene: Scene) -> None:
    """Draw a plan as executed: in space, in the latent space and over time."""
    figure.set_size_inches(10.5, 5.6)
    maps, right = _columns(figure, scene)
    for axes, plane in _maps(figure, maps, scene):
        subplots_space.executed(axes, scene, plane, list(range(scene.trajectories.episodes)))
        subplots_space.waypoints(axes, scene, plane)
    grid = right.subgridspec(2, 2, width_ratios=[3, 2])
    above, below = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    subplots_time.latent_components(above, scene, 0)
    subplots_time.waypoint_distance(below, scene, 0)
    above.sharex(below)
    above.tick_params(labelbottom=False)
    place = grid[0, 1] if len(scene.waypoints) else grid[:, 1]
    subplots_space.latents(figure.add_subplot(place), scene, (0, 1), route=0)
    if len(scene.waypoints):
        subplots_time.closest(figure.add_subplot(grid[1, 1]), scene)
    _head(figure, scene)
    _skill_legend(figure, scene, subplots_space.skills_in_use(scene))


@FIGURES.register(TRANSFER_EVAL)
def _transferred(figure: Figure, scene: Scene) -> None:
    """Compare domains: every path, the success with its interval, and the final distances."""
    names = list(motion.domains(scene))
    columns = min(len(names), MAX_COLUMNS)
    rows = -(-len(names) // columns)
    low, high = subplots_space.limits(scene, (0, 1))
    width = 10.5
    height = np.clip(width / columns * (high - low)[1] / (high - low)[0], 2.2, 3.6)
    figure.set_size_inches(width, rows * height + 3.4)
    outer = figure.add_gridspec(2, 1, height_ratios=[rows * height, 2.8])
    grid = outer[0].subgridspec(rows, columns)
    for place, (name, episodes) in enumerate(motion.domains(scene).items()):
        axes = figure.add_subplot(grid[place // columns, place % columns])
        subplots_space.executed(axes, scene, (0, 1), episodes)
        subplots_space.waypoints(axes, scene, (0, 1))
        subplots_transfer.entitle(axes, scene, name, episodes)
    lower = outer[1].subgridspec(1, 2)
    subplots_transfer.success(figure.add_subplot(lower[0]), scene)
    subplots_transfer.final_distances(figure.add_subplot(lower[1]), scene)
    _head(figure, scene)
    _skill_legend(figure, scene, subplots_space.skills_in_use(scene))


@FIGURES.register(EXECUTION)
def _executed(figure: Figure, scene: Scene) -> None:
    """Draw what an arm did beside what was planned: in space, and over time."""
    figure.set_size_inches(10.5, 5.6)
    maps, right = _columns(figure, scene)
    episodes = list(range(scene.trajectories.episodes))
    for axes, plane in _maps(figure, maps, scene):
        subplots_space.executed(axes, scene, plane, episodes)
        subplots_space.planned(axes, scene, plane)
        subplots_space.waypoints(axes, scene, plane)
    grid = right.subgridspec(2, 2)
    subplots_time.against_plan(figure.add_subplot(grid[0, :]), scene)
    subplots_transfer.success(figure.add_subplot(grid[1, 0]), scene)
    subplots_transfer.final_distances(figure.add_subplot(grid[1, 1]), scene)
    _head(figure, scene)
    _skill_legend(figure, scene, subplots_space.skills_in_use(scene))


# --- shared parts -----------------------------------------------------------------------------------------------------


def _columns(figure: Figure, scene: Scene) -> tuple[SubplotSpec, SubplotSpec]:
    """Return the column of the maps, as wide as their shape needs, and the rest of the figure."""
    width, height = figure.get_size_inches()
    spans = [high - low for low, high in (subplots_space.limits(scene, plane) for plane in subplots_space.planes(scene))]
    wanted = 0.85 * height * spans[0][0] / sum(span[1] for span in spans)
    share = float(np.clip(wanted, 0.22 * width, 0.42 * width)) / width
    grid: GridSpec = figure.add_gridspec(1, 2, width_ratios=[share, 1 - share])
    return grid[0], grid[1]


def _maps(figure: Figure, place: SubplotSpec, scene: Scene) -> list[tuple[Axes, tuple[int, int]]]:
    """Make one axes per projection, one above the other, with heights in proportion to their ranges."""
    planes = subplots_space.planes(scene)
    spans = [float(np.ptp(subplots_space.limits(scene, plane), axis=0)[1]) for plane in planes]
    grid = place.subgridspec(len(planes), 1, height_ratios=spans)
    return [(figure.add_subplot(grid[row, 0]), plane) for row, plane in enumerate(planes)]


def _split(figure: Figure, grid: Any, row: int, count: int) -> list[Axes]:
    """Make subplots of equal width in a row of six columns."""
    each = 6 // count
    return [figure.add_subplot(grid[row, i * each : (i + 1) * each]) for i in range(count)]


def _head(figure: Figure, scene: Scene) -> None:
    """Write the artifact's id and the sample sizes."""
    episodes, at_means = scene.trajectories.episodes, len(motion.mean_episodes(scene))
    counted = f"{episodes} episode" + ("s" if episodes != 1 else "")
    if scene.runs.held:
        sampled = episodes - at_means
        others = "sampled latents" if scene.runs is Runs.SAMPLED else "means of two neighbours"
        counted = f"{at_means} skills at their mean latents" + (f", {sampled} {others}" if sampled else "")
    elif scene.runs is Runs.PLANNED and episodes > 1:
        counted += f", over time: {scene.episode_labels[0]}"
    figure.suptitle(f"{scene.title}   (n = {counted})", x=0.01, ha="left", fontsize=9.5, fontweight="bold")


def _skill_legend(figure: Figure, scene: Scene, skills: range | list[int]) -> None:
    """Explain number, name and style of the skills in use, and the marks of an execution, below everything."""
    names = ["between (mixed)" if skill < 0 else subplots_space.numbered(scene, skill) for skill in skills]
    handles: list[Artist] = [*skill_handles(zip(skills, names, strict=True))]
    if not scene.runs.held:
        handles += [mark("start", "o", "white"), mark("success", "o"), mark("failure", "X", "white")]
        handles += [mark("goal of a skill", "+", size=6)]
        if any(scene.trajectories.first_violations):
            handles.append(mark("first beyond a safety limit", subplots_space.VIOLATION, "white", size=5))
    if scene.runs is Runs.BETWEEN and scene.trajectories.episodes > len(scene.skills):
        handles.append(Line2D([], [], color=TARGET, ls=":", marker="D", ms=3.5, label="mean of two neighbours"))
        handles.append(mark("half-way between their goals", "x", size=5))
    if scene.trajectories.object_pose is not None and scene.trajectories.gripper_position is not None:
        handles.append(Line2D([], [], color=BETWEEN, lw=0.6, label="gripper"))
    legend(figure, handles, width=150)
