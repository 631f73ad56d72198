"""Place goals and starts on other arms than the default one: the same shape, as large as the arm can reach."""

from __future__ import annotations

from collections.abc import Sequence

from skillcli.errors import UsageError
from skillcli.robots.config import DEFAULT_ROBOT, blaming, describe_robot
from skillcli.robots.robot import Robot
from skillcli.simulation.settings import ArmTask

SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)  # of the task's size, after scaling to the arm's reach
ROOM = 1.15  # places farther from the middle by this factor must be within reach too


def relative_reach(robot: Robot) -> float:
    """Return the reach of an arm, as a share of the reach of the tasks' default arm."""
    own = describe_robot(DEFAULT_ROBOT).workspace
    assert own is not None
    return robot.workspace.reach / own.reach


def given_start(task: ArmTask, robot: Robot, of_file: Sequence[float] | None) -> tuple[float, ...] | None:
    """Return the start from the recipe, else from the robot's file, (n,) rad; None without both.

    Raises:
        UsageError: it does not fit the arm.
    """
    start = task.start or of_file
    if not start:
        return None
    with blaming(robot.path):
        robot.check_start(tuple(start))
    return tuple(start)


def no_place(robot: Robot, task: str, keys: str) -> UsageError:
    """Make the error for a task without room on an arm."""
    return UsageError(
        f"no place for the {task} task was found on {robot.name!r}, which reaches {robot.workspace.reach:.2f} m",
        f"look at it with `skill robots show {robot.which} --png arm.png`: it has to stand at z = 0 and look along x, else "
        f"turn or move it with [base] of its file; or give {keys} in the recipe",
    )
