"""A robot at its start, from the side and from above, and the range of its gripper."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull, QhullError

from skillcli.robots.posture import posed
from skillcli.robots.robot import Robot
from skillcli.robots.scene import GRIPPER
from skillcli.robots.shapes import CORNERS, mesh_vertices
from skillcli.trajectories import Array
from skillcli.viz.figure_style import WIDTH, blank
from skillcli.viz.kinematics import drawn_geoms, geom_color, moves

VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
ROUND = 16  # points of a circle
MARGIN = 0.05  # m around the arm


def draw_robot(robot: Robot, start: tuple[float, ...], goals: Array) -> Figure:
    """Draw the arm at a start, with goals that lie in its workspace.

    Args:
        robot: the arm.
        start: joint vector (n,) rad.
        goals: (K, 3) m, K may be 0.
    """
    data = posed(robot.model, robot.names, start)
    gripper = data.site(GRIPPER).xpos
    outlines = list(_outlines(robot.model, data))
    figure = blank(WIDTH, 3.2)
    for axes, (title, across, up) in zip(np.ravel(figure.subplots(1, 2)), VIEWS, strict=True):
        for points, color in outlines:
            _fill(axes, points[:, [across, up]], color)
        axes.scatter(goals[:, across], goals[:, up], s=14, marker="s", c="none", edgecolors="black", lw=0.7, zorder=4)
        axes.scatter(gripper[across], gripper[up], s=18, c="black", marker="x", zorder=5)
        _workspace(axes, robot, across, up)
        axes.set_title(f"{robot.name} {title}")
        axes.set(xlabel=f"{'xyz'[across]} in m", ylabel=f"{'xyz'[up]} in m", aspect="equal")
        everything = np.concatenate([*(points for points, _ in outlines), goals, gripper[None]])
        low, high = everything.min(axis=0) - MARGIN, everything.max(axis=0) + MARGIN
        axes.set(xlim=(low[across], high[across]), ylim=(low[up], high[up]))
        axes.grid(True)
    return figure


def _workspace(axes: Any, robot: Robot, across: int, up: int) -> None:
    """Draw the circle that the gripper cannot leave."""
    angles = np.linspace(0, 2 * np.pi, 200)
    room = robot.workspace
    x, y = room.shoulder[across] + room.reach * np.cos(angles), room.shoulder[up] + room.reach * np.sin(angles)
    axes.plot(x, y, lw=0.8, ls="--", color="#888888")


def _outlines(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    """Yield points whose hull is the outline of each geom of the arm, (P, 3) m, and its colour; lower ones first."""
    drawn = drawn_geoms(model)
    drawn.pop(model.body("table").id, None)
    geoms = [geom for each in drawn.values() for geom in each]
    for geom in sorted(geoms, key=lambda geom: float(data.geom_xpos[geom, 2])):
        points = _surface(model, geom) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        moving = moves(model, int(model.geom_bodyid[geom]))
        yield points, geom_color(model, geom) if moving else np.array([0.4, 0.4, 0.42, 1.0])


def _surface(model: mujoco.MjModel, geom: int) -> Array:
    """Return points on a geom in its own frame, (P, 3) m, that span its convex hull."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return mesh_vertices(model, model.geom_dataid[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners: Array = CORNERS * size
        return corners
    turn = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        ring = np.stack([size[0] * np.cos(turn), size[0] * np.sin(turn), np.zeros(ROUND)], axis=1)
        return _both_ends(ring, size[1])
    tilt = np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2 + 1)
    sphere = np.array([[np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)] for a in turn for b in tilt])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _both_ends(size[0] * sphere, size[1])
    radii = np.repeat(size[:1], 3) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
    scaled: Array = sphere * radii
    return scaled


def _both_ends(points: Array, half: float) -> Array:
    """Return points (P, 3) m moved up and down the z axis by half a length, (2P, 3) m."""
    along = np.array([0.0, 0.0, half])
    return np.concatenate([points + along, points - along])


def _fill(axes: Any, points: Array, color: Array) -> None:
    """Fill the hull of projected points (P, 2) m."""
    try:
        outline = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # all on a line
        return
    axes.add_patch(Polygon(outline, facecolor=color[:3], edgecolor="black", lw=0.3, alpha=max(0.3, float(color[3])), zorder=2))
