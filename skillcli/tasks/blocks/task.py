"""The spec of the blocks task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.goals import check_in_reach, listed
from skillcli.tasks.on_table import check_start_on_table, room_on_table
from skillcli.tasks.spec import FigureSettings, TaskEnvironment, TaskSpec
from skillcli.trajectories import Array


def _environment() -> TaskEnvironment:
    from skillcli.tasks.blocks.environment import BlocksEnvironment

    return BlocksEnvironment


def _place_goal(task: BlocksTask, goal: Sequence[float]) -> list[float]:
    return [*goal]


def _check_goal(task: BlocksTask, robot: Robot, goal: Array) -> None:
    lowest, highest = room_on_table(_margin(task))
    if ((goal[:2] < lowest) | (goal[:2] > highest)).any():
        raise UsageError(
            f"goal {listed(goal)} leaves no room for the block on the table",
            f"there is room for it at {listed(lowest)} .. {listed(highest)} m",
        )
    check_in_reach(task, robot, goal)


def _check_start(task: BlocksTask, low: float, high: float) -> None:
    check_start_on_table("a block at task.block_start", task.block_start, _margin(task), low, high)


def _margin(task: BlocksTask) -> float:
    """Return how far the middle of a block must be from the rim of the table, m."""
    return task.block_size


def _place(task: BlocksTask, robot: Robot) -> dict[str, Any]:
    from skillcli.tasks.blocks.placement import place_blocks

    return place_blocks(task, robot)


TASK = TaskSpec(
    name="blocks",
    description="the arm's hand grasps a block, carries it and puts it down, with real contact",
    settings=BlocksTask,
    environment=_environment,
    place_goal=_place_goal,
    example="0.55,0.1,0.02",
    check_goal=_check_goal,
    check_start=_check_start,
    placed=("start", "action_limit"),
    place=_place,
    figure_settings=FigureSettings(((0, 1), (0, 2)), "block"),
    robot="panda",
    grasps=True,
)
