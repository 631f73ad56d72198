"""The spec of the blocks task."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.tasks.blocks.cost_to_go import BlockCostToGo
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.goals import as_typed, check_in_reach, listed
from skillcli.tasks.on_table import check_goal_on_table, check_start_on_table
from skillcli.tasks.spec import FigureSettings, Route, TaskEnvironment, TaskSpec
from skillcli.trajectories import Array

TOWER = ((0.55, 0.1, 0.06), (0.55, 0.1, 0.1))  # m, places of the second and the third block of a tower, and what lies there
LYING = ((0.45, -0.1), (0.55, 0.1))  # m: the third block, and the lowest
BASES = ((0.45, 0.1), (0.55, -0.1))  # m, blocks to stack another one on


def _environment() -> TaskEnvironment:
    from skillcli.tasks.blocks.environment import BlocksEnvironment

    return BlocksEnvironment


def _check_goal(task: BlocksTask, robot: Robot, goal: Array) -> None:
    check_goal_on_table("goal", "block", goal[:2], _margin(task), "there is room for it at {low} .. {high} m")
    check_in_reach(task, robot, goal)
    _check_others(task, 0.0, 0.0)


def _check_start(task: BlocksTask, low: float, high: float) -> None:
    check_start_on_table("a block at task.block_start", task.block_start, _margin(task), low, high)
    _check_others(task, low, high)


def _check_others(task: BlocksTask, low: float, high: float) -> None:
    """Refuse further blocks off the table, or where blocks could overlap when the first one is moved `low` to `high` m."""
    blocks = [(np.add(task.block_start, low), np.add(task.block_start, high))]
    for place in task.others:
        check_start_on_table("a block of task.others at", place, _margin(task), 0.0, 0.0)
        here = np.array(place)
        if any(np.linalg.norm(here - np.clip(here, *corners)) < math.sqrt(2) * task.block_size for corners in blocks):
            raise UsageError(
                f"the block of task.others at {listed(here)} may overlap with another one",
                f"leave {math.sqrt(2) * task.block_size:.3f} m, the diagonal of a block, between their middles, wherever"
                f" the first one begins: {listed(blocks[0][0])} .. {listed(blocks[0][1])} m",
            )
        blocks.append((here, here))


def _margin(task: BlocksTask) -> float:
    """Return how far the middle of a block must be from the rim of the table, m."""
    return task.block_size


def _place(task: BlocksTask, robot: Robot) -> dict[str, Any]:
    from skillcli.tasks.blocks.placement import place_blocks

    return place_blocks(task, robot)


def _places() -> tuple[Route, ...]:
    """Return twenty places on the table between the corners that blocks are carried to, drawn once."""
    rng = random.Random(0)
    return tuple(((round(rng.uniform(0.4, 0.6), 3), round(rng.uniform(-0.15, 0.15), 3), 0.02),) for _ in range(20))


def _aims(task: BlocksTask, waypoint: Array) -> tuple[Array, ...]:
    """Return the place over a waypoint, from which a block is let down, and the waypoint."""
    return (np.array([*waypoint[:2], task.carry_height]), waypoint)


TASK = TaskSpec(
    name="blocks",
    description="the arm's hand grasps a block, carries it and puts it down, with real contact",
    settings=BlocksTask,
    environment=_environment,
    place_goal=as_typed,
    example="0.55,0.1,0.02",
    check_goal=_check_goal,
    check_start=_check_start,
    placed=("start", "action_limit"),
    place=_place,
    compositions={"pick-and-place": _places(), "stack": tuple(((*base, 0.06),) for base in BASES), "tower": (TOWER,)},
    scenes={"stack": {"others": BASES}, "tower": {"others": LYING, "build": TOWER}},
    cost_to_go=lambda task: BlockCostToGo(task.carry_height),
    aims=_aims,
    figure_settings=FigureSettings(((0, 1), (0, 2)), "block"),
    robot="panda",
    grasps=True,
)
