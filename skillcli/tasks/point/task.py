"""The spec of the point task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.tasks.goals import typed
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.spec import FigureSettings, TaskEnvironment, TaskSpec
from skillcli.trajectories import Array


def _environment() -> TaskEnvironment:
    from skillcli.tasks.point.environment import PointEnvironment

    return PointEnvironment


def _place_goal(task: PointTask, goal: Sequence[float]) -> list[float]:
    return [*goal, 0.0]


def _check_goal(task: PointTask, robot: Robot, goal: Array) -> None:
    if np.abs(goal[:2]).max() > task.bound:
        raise UsageError(f"goal {typed(goal)} is out of bounds", f"both coordinates must lie within ±{task.bound:g} m")


TASK = TaskSpec(
    name="point",
    description="a point in the plane moved by velocity; no physics, trains in seconds",
    settings=PointTask,
    environment=_environment,
    place_goal=_place_goal,
    example="1.0,2.0",
    check_goal=_check_goal,
    compositions={"triangle": (((2.0, 1.0), (-2.0, 1.0), (0.0, -2.0)),)},
    uses_robot=False,
    figure_settings=FigureSettings(((0, 1),), "point", ("m", 1.0), (1, 2), "m per step", goal_size=2),
)
