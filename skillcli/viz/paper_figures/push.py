"""Figures of the push task, from above; lengths are displacements of the box from its start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from skillcli.metrics import angle_deg, neighbours
from skillcli.trajectories import Array
from skillcli.viz import motion, subplots_space
from skillcli.viz.figure_style import WIDTH, blank, legend, mark, skill_handles
from skillcli.viz.palette import BETWEEN, TARGET, look
from skillcli.viz.scene import Runs, Scene

COLUMNS = 4
MAX_ROUTES = 16
HALF = 0.03  # m, half the side of the box if the model does not say


def skill_pushes(scene: Scene) -> Figure:
    """Draw box and gripper paths of every skill at its mean latent and its sampled latents (paper figure 7).

    Args:
        scene: of a pretrain or embed-means artifact.
    """
    skills, at_means = range(len(scene.skills)), motion.mean_episodes(scene)
    grid = _grid(len(skills), 0.75)
    for skill, axes in zip(skills, grid[1], strict=False):
        style = look(skill)
        others = range(scene.trajectories.episodes) if scene.runs is Runs.SAMPLED else ()
        for episode in others:
            if motion.episode_skill(scene, episode) == skill and episode not in at_means.values():
                axes.plot(*_moved(scene, episode).T, color=style.color, lw=0.5, alpha=0.45, zorder=2)
        if skill in at_means:
            _push(axes, scene, at_means[skill], [motion.Piece(0, int(scene.trajectories.length[at_means[skill]]), skill)])
        _goal(axes, scene, _local(scene, scene.goals[skill], at_means.get(skill, 0)))
        _name(axes, subplots_space.numbered(scene, skill))
    _equal_limits(grid[1])
    handles = skill_handles(((k, subplots_space.numbered(scene, k)) for k in skills), marked=False)
    legend(grid[0], [*handles, *_marks(), *([_thin("sampled latents")] if scene.runs is Runs.SAMPLED else [])])
    return grid[0]


def mean_pushes(scene: Scene, recorded: Mapping[frozenset[str], tuple[float, float]]) -> Figure:
    """Draw where the mean of two neighbouring skills pushes the box, and the error of its direction (paper figure 8).

    Args:
        scene: of an embed-means artifact; the episodes after the skills' own are those of `neighbours`.
        recorded: displacements m that the paper recorded, by the two names; may be empty.
    """
    pairs = neighbours(scene.goals)
    figure = blank(WIDTH, 3.3)
    above, off = figure.subplots(1, 2, width_ratios=[1, 1.1])
    labels, rows = [], []
    for row, (a, b) in enumerate(pairs):
        episode = len(scene.skills) + row
        moved, style = _moved(scene, episode), look(row)
        wanted = _local(scene, scene.trajectories.target[episode], episode)
        above.plot(*moved.T, color=style.color, ls=style.dash, zorder=3)
        above.plot(*moved[-1], color=style.color, marker=style.marker, ms=6, zorder=4)
        above.plot(*wanted, color=TARGET, marker="x", ms=6, zorder=4)
        theirs = recorded.get(frozenset((scene.skills[a], scene.skills[b])))
        if theirs:
            above.plot(*theirs, color=style.color, marker=style.marker, mfc="white", ms=6, zorder=4)
        labels.append(f"{scene.skills[a]} and {scene.skills[b]}")
        rows.append((angle_deg(moved[-1], wanted), angle_deg(np.array(theirs), wanted) if theirs else None, style))
    above.plot(0, 0, color="black", marker="o", mfc="white", ms=4, zorder=5)
    above.set(aspect="equal", xlabel="Δx of the box [m]", ylabel="Δy of the box [m]", title="where the box goes")
    reach = 1.12 * max(np.abs([above.get_xlim(), above.get_ylim()]).max(), 0.1)
    above.set(xlim=(-reach, reach), ylim=(-reach, reach))
    above.grid(True)
    for row, (ours, theirs_deg, style) in enumerate(rows):
        for value, filling in ((ours, style.color), (theirs_deg, "white")):
            if value is not None:
                off.plot(value, row, color=style.color, marker=style.marker, mfc=filling, ms=6, ls="none", zorder=3)
    off.axvline(0, color=TARGET, lw=0.8)
    off.set_yticks(range(len(rows)), labels)
    off.set(
        ylim=(len(rows) - 0.5, -0.5), xlim=(-2, None), xlabel="angle to half-way between the goals [°]", title="direction error"
    )
    off.grid(True)
    handles = [
        Line2D([], [], color=style.color, ls=style.dash, marker=style.marker, ms=5, label=label)
        for label, (_, _, style) in zip(labels, rows, strict=True)
    ]
    marks = [mark("half-way between the goals", "x", size=5), mark("start", "o", "white"), mark("here", "s")]
    legend(figure, [*handles, *marks, *([mark("Julian et al. 2018", "s", "white")] if recorded else [])])
    return figure


def searched_pushes(routes: Sequence[tuple[Scene, int]]) -> Figure:
    """Draw searched pushes one by one, coloured by the skill that is held (paper figure 9).

    Args:
        routes: scenes of compose artifacts, and an episode of each; at most `MAX_ROUTES` are drawn.
    """
    routes = routes[:MAX_ROUTES]
    figure, panels = _grid(len(routes), 0.6)
    for (scene, episode), axes in zip(routes, panels, strict=True):
        _push(axes, scene, episode, motion.pieces(scene, episode))
        axes.add_patch(Polygon(_square(scene, episode), fill=False, ec=BETWEEN, lw=0.8, ls=(0, (3, 2)), zorder=1))
        target = _local(scene, scene.trajectories.target[episode], episode)
        _goal(axes, scene, target)
        gap = 100 * float(np.linalg.norm(_moved(scene, episode)[-1] - target))
        x, y = (f"{round(float(value), 3) + 0.0:g}".replace("-", "−") for value in target)
        _name(axes, f"({x}, {y}): {gap:.1f} cm")
    _equal_limits(panels)
    fed = sorted({k for scene, _ in routes for k in subplots_space.skills_in_use(scene)}, key=lambda k: (k < 0, k))
    names = [(k, "between (mixed)" if k < 0 else subplots_space.numbered(routes[0][0], k)) for k in fed]
    square = Line2D([], [], color=BETWEEN, lw=0.8, ls=(0, (3, 2)), label="trained square")
    legend(figure, [*skill_handles(names, marked=False), *_marks(), square])
    return figure


# --- parts ------------------------------------------------------------------------------------------------------------


def _grid(count: int, room: float) -> tuple[Figure, list[Axes]]:
    """Make small maps in rows of `COLUMNS` with common scales, and `room` inches below for the legend."""
    columns = min(count, COLUMNS)
    rows = max(1, math.ceil(count / columns))
    figure = blank(WIDTH, 1.75 * rows + room)
    panels = [figure.add_subplot(rows, columns, place + 1) for place in range(count)]
    for place, axes in enumerate(panels):
        axes.set(aspect="equal")
        axes.grid(True)
        axes.tick_params(labelbottom=place + columns >= count, labelleft=place % columns == 0)
        if place + columns >= count:
            axes.set_xlabel("Δx [m]")
        if place % columns == 0:
            axes.set_ylabel("Δy [m]")
    return figure, panels


def _name(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=8)


def _local(scene: Scene, place: Array, episode: int) -> Array:
    """Return a place, (..., 2 or 3) m, relative to the start of the box."""
    seen: Array = place[..., :2] - motion.path(scene, episode)[0, :2]
    return seen


def _moved(scene: Scene, episode: int) -> Array:
    """Return the displacement of the box from its start, (length+1, 2) m."""
    return _local(scene, motion.path(scene, episode), episode)


def _push(axes: Axes, scene: Scene, episode: int, pieces: Sequence[motion.Piece]) -> None:
    """Draw one push: gripper thin, box in the style of each piece's skill, its outline at start and end."""
    moved, data = _moved(scene, episode), scene.trajectories
    if data.gripper_position is not None:
        hand = _local(scene, data.gripper_position[episode, : len(moved)], episode)
        axes.plot(*hand.T, color=TARGET, lw=0.6, zorder=2)
    for piece in pieces:
        style = motion.piece_look(scene, episode, piece)
        axes.plot(*moved[piece.start : piece.stop + 1].T, color=style.color, ls=style.dash, lw=1.8, zorder=4)
    for row, filled in ((0, False), (len(moved) - 1, True)):
        corners = _corners(scene, episode, row) + moved[row]
        face = "#00000018" if filled else "none"
        axes.add_patch(Polygon(corners, fc=face, ec=TARGET, lw=0.8, ls="-" if filled else ":", zorder=3))
    axes.plot(*moved[-1], color="black", marker="o", ms=3.5, zorder=5)


def _corners(scene: Scene, episode: int, row: int) -> Array:
    """Return the corners of the box in its orientation, relative to its centre, (4, 2) m."""
    sides = np.array([HALF, HALF])
    if scene.model is not None:
        body = scene.model.body("box")
        sides = scene.model.geom_size[int(body.geomadr[0]), :2]
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * sides
    assert scene.trajectories.object_pose is not None
    w, x, y, z = scene.trajectories.object_pose[episode, row, 3:]
    turn = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    cos, sin = math.cos(turn), math.sin(turn)
    turned: Array = corners @ np.array([(cos, sin), (-sin, cos)])
    return turned


def _goal(axes: Axes, scene: Scene, place: Array) -> None:
    """Draw a goal with its tolerance."""
    spot = (float(place[0]), float(place[1]))
    axes.add_patch(Circle(spot, scene.tolerance, fc="none", ec=TARGET, lw=0.8, ls=(0, (1, 1)), zorder=1))
    axes.plot(*spot, color=TARGET, marker="x", ms=5, zorder=6)


def _square(scene: Scene, episode: int) -> Array:
    """Return the corners of the square whose sides pass through the skills' goals, (4, 2) m."""
    goals = _local(scene, scene.goals, episode)
    (left, low), (right, high) = goals.min(axis=0), goals.max(axis=0)
    return np.array([(left, low), (right, low), (right, high), (left, high)])


def _equal_limits(panels: Sequence[Axes]) -> None:
    """Set the same square limits on all maps, so that they can be compared by eye."""
    reach = max(np.abs([axes.get_xlim(), axes.get_ylim()]).max() for axes in panels)
    for axes in panels:
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axes.locator_params(nbins=4)


def _marks() -> list[Artist]:
    hand = Line2D([], [], color=TARGET, lw=0.6, label="gripper")
    first, last = (
        Patch(fc="none", ec=TARGET, ls=":", label="box, start"),
        Patch(fc="#00000018", ec=TARGET, label="box, end"),
    )
    return [hand, first, last, mark("goal", "x", size=5)]


def _thin(label: str) -> Line2D:
    return Line2D([], [], color=BETWEEN, lw=0.5, label=label)
