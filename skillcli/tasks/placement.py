"""Where goals and starts lie on an arm that a task was not written for: the same shape, as large as the arm can hold it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.config import DEFAULT_ROBOT, blaming, describe_robot
from skillcli.robots.robot import Robot

SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)  # of the task's size, after it was scaled to the arm's reach
ROOM = 1.15  # places this much farther from the middle must be within reach too
SPEED_SHARE = 0.95  # of a joint's largest speed that commands ask for at most


def relative_reach(robot: Robot) -> float:
    """How far an arm reaches, as a share of what the arm does that the tasks were written for."""
    own = describe_robot(DEFAULT_ROBOT).workspace
    assert own is not None
    return robot.workspace.reach / own.reach


def given_start(given: Mapping[str, Any], robot: Robot, of_file: Sequence[float] | None) -> tuple[float, ...] | None:
    """The start that a recipe gives, else the one of the robot's file, (n,) rad; None where neither does.

    Raises:
        UsageError: it is not one of this arm.
    """
    start = given.get("start") or of_file
    if not start:
        return None
    with blaming(robot.path):
        robot.check_start(tuple(start))
    return tuple(start)


def largest_action(robot: Robot, usual: float, period: float) -> float:
    """Largest joint increment for each control step, rad: the usual one, or what the slowest joint can follow."""
    slowest = float(np.min(robot.speed_limit))
    return min(usual, float(np.floor(SPEED_SHARE * slowest * period * 1000) / 1000)) if np.isfinite(slowest) else usual


def no_place(robot: Robot, task: str, keys: str) -> UsageError:
    """The error of a task that an arm has no room for."""
    return UsageError(
        f"no place for the {task} task was found on {robot.name!r}, which reaches {robot.workspace.reach:.2f} m",
        f"give {keys} in the recipe; `skill robots show` prints where the gripper can be",
    )
