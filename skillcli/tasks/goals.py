"""Checks of goals shared by the arm tasks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.simulation.settings import ArmTask
from skillcli.trajectories import Array


def as_typed(_: ArmTask, goal: Sequence[float]) -> list[float]:
    """Return a typed goal, which is its place, (3,) m."""
    return [*goal]


def check_in_reach(task: ArmTask, robot: Robot, goal: Array) -> None:
    """Refuse a goal (3,) m that the gripper cannot get to whatever the skills.

    Raises:
        UsageError: it is too far away, inside the base, or below the table.
    """
    room, shoulder = robot.workspace, np.array(robot.workspace.shoulder)
    distance = float(np.linalg.norm(goal - shoulder))
    if distance > room.reach:
        raise UsageError(
            f"goal {typed(goal)} is out of reach: {distance:.2f} m from the shoulder at {listed(shoulder)}",
            f"the arm with its finger reaches {room.reach:.2f} m; trained goals lie at {bounds(np.array(task.goals))}",
        )
    if np.hypot(goal[0], goal[1]) < room.base_radius and goal[2] < room.base_height:
        raise UsageError(
            f"goal {typed(goal)} lies inside the robot's own base",
            f"keep {room.base_radius:g} m away from the axis of the first joint",
        )
    if goal[2] < TABLE_TOP:
        raise UsageError(f"goal {typed(goal)} lies below the table", f"the table top is at z = {TABLE_TOP:g} m")


def typed(goal: Array) -> str:
    """Write a position as it is typed."""
    return ",".join(f"{x:g}" for x in goal)


def listed(numbers: Array) -> str:
    """Write a point in brackets."""
    return "(" + ", ".join(f"{x:g}" for x in numbers) + ")"


def bounds(points: Array) -> str:
    """Write the lowest and the highest corner of points (n, d)."""
    return " .. ".join(listed(corner) for corner in (points.min(axis=0), points.max(axis=0)))
