"""The spec of the push task."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.tasks.goals import check_in_reach
from skillcli.tasks.on_table import check_goal_on_table, check_start_on_table
from skillcli.tasks.push.cost_to_go import BoxCostToGo
from skillcli.tasks.push.settings import MOST_TURN, TURN, PushTask
from skillcli.tasks.spec import FigureSettings, Route, TaskEnvironment, TaskSpec
from skillcli.trajectories import Array


def _environment() -> TaskEnvironment:
    from skillcli.tasks.push.environment import PushEnvironment

    return PushEnvironment


def _place_goal(task: PushTask, goal: Sequence[float]) -> list[float]:
    """Convert a displacement of the box to a place, from its nominal start; a turn becomes the third coordinate, see `TURN`."""
    return [task.box_start[0] + goal[0], task.box_start[1] + goal[1], TURN * goal[2] if task.turns else 0.0]


def _check_goal(task: PushTask, robot: Robot, goal: Array) -> None:
    hint = "displacements lie between {low} and {high} m"
    check_goal_on_table("displacement", "box", goal[:2], _margin(task), hint, task.box_start)
    check_in_reach(task, robot, goal * [1.0, 1.0, 0.0])
    if abs(goal[2]) > TURN * MOST_TURN:
        raise UsageError(
            f"a turn of {goal[2] / TURN:g} rad is too far", f"a box may be turned by up to {MOST_TURN:g} rad to either side"
        )


def _check_start(task: PushTask, low: float, high: float) -> None:
    check_start_on_table("a box at task.box_start", task.box_start, _margin(task), low, high)


def _margin(task: PushTask) -> float:
    """Return how far the middle of a box must be from the rim of the table, for any quarter turn, m."""
    return max(task.box_size[:2]) / 2


def _ring() -> tuple[Route, ...]:
    """Return a goal every 30 degrees, 20 cm from the start: outside the square of the bundled skills."""
    angles = [math.radians(angle) for angle in range(0, 360, 30)]
    return tuple(((round(0.2 * math.cos(angle), 4), round(0.2 * math.sin(angle), 4)),) for angle in angles)


def _place(task: PushTask, robot: Robot) -> dict[str, Any]:
    from skillcli.tasks.push.placement import place_push

    return place_push(task, robot)


TASK = TaskSpec(
    name="push",
    description="the arm's finger pushes a box over the table, with real contact",
    settings=PushTask,
    environment=_environment,
    place_goal=_place_goal,
    example="0.1,-0.1",
    check_goal=_check_goal,
    check_start=_check_start,
    placed=("box_start", "start", "action_limit"),
    place=_place,
    compositions={"ring": _ring()},
    cost_to_go=lambda task: BoxCostToGo((task.box_size[0] / 2, task.box_size[1] / 2)),
    figure_settings=FigureSettings(((0, 1),), "box", goal_size=2, goals_from_start=True),
)
