"""The spec of the reach task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillcli.robots.robot import Robot
from skillcli.tasks.goals import check_in_reach
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.spec import TaskEnvironment, TaskSpec


def _environment() -> TaskEnvironment:
    from skillcli.tasks.reach.environment import ReachEnvironment

    return ReachEnvironment


def _place_goal(task: ReachTask, goal: Sequence[float]) -> list[float]:
    return [*goal]


def _place(given: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    from skillcli.tasks.reach.placement import place_reach

    return place_reach(given, robot)


TASK = TaskSpec(
    name="reach",
    description="the arm's gripper goes to points in space, joint increments at 20 Hz",
    settings=ReachTask,
    environment=_environment,
    place_goal=_place_goal,
    example="0.6,0.0,0.2",
    placed=("goals", "start", "action_limit"),
    place=_place,
    check_goal=check_in_reach,
    compositions={
        # Julian et al. 2018, the searched triangle
        "triangle": (((0.6, 0.3, 0.15), (0.6, -0.3, 0.15), (0.6, 0.0, 0.3), (0.6, 0.3, 0.15)),),
    },
    chains={"u-shape": "3,4,8,7"},  # Julian et al. 2018: draws a U
)
