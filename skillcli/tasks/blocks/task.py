"""The spec of the blocks task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_CENTRE, TABLE_HALF_SIZE
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.goals import check_in_reach, listed
from skillcli.tasks.spec import FigureSettings, TaskEnvironment, TaskSpec
from skillcli.trajectories import Array


def _environment() -> TaskEnvironment:
    from skillcli.tasks.blocks.environment import BlocksEnvironment

    return BlocksEnvironment


def _place_goal(task: BlocksTask, goal: Sequence[float]) -> list[float]:
    return [*goal]


def _check_goal(task: BlocksTask, robot: Robot, goal: Array) -> None:
    lowest, highest = _room(task)
    if ((goal[:2] < lowest) | (goal[:2] > highest)).any():
        raise UsageError(
            f"goal {listed(goal)} leaves no room for the block on the table",
            f"there is room for it at {listed(lowest)} .. {listed(highest)} m",
        )
    check_in_reach(task, robot, goal)


def _check_start(task: BlocksTask, low: float, high: float) -> None:
    """Refuse a block that may start off the table, drawn from `low` to `high` m off its nominal start in x and y."""
    lowest, highest = _room(task)
    if not ((lowest <= np.array(task.block_start) + low) & (np.array(task.block_start) + high <= highest)).all():
        raise UsageError(
            f"a block at task.block_start {listed(np.array(task.block_start))} may start off the table",
            f"there is room for it at {listed(lowest)} .. {listed(highest)} m",
        )


def _room(task: BlocksTask) -> tuple[Array, Array]:
    """Return the lowest and highest place of a block on the table, (2,) m each."""
    room = np.array(TABLE_HALF_SIZE[:2]) - task.block_size
    return TABLE_CENTRE - room, TABLE_CENTRE + room


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
