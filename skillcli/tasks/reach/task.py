"""The spec of the reach task."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillcli.robots.robot import Robot
from skillcli.tasks.goals import as_typed, check_in_reach
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.spec import Route, TaskEnvironment, TaskSpec


def _environment() -> TaskEnvironment:
    from skillcli.tasks.reach.environment import ReachEnvironment

    return ReachEnvironment


def _place(task: ReachTask, robot: Robot) -> dict[str, Any]:
    from skillcli.tasks.reach.placement import place_reach

    return place_reach(task, robot)


def _fit_route(task: ReachTask, route: Route) -> Route:
    """Move and scale a route as the box around the task's goals is moved and scaled against that of the usual goals."""
    usual, goals = np.array(ReachTask.model_fields["goals"].default), np.array(task.goals)
    if np.array_equal(usual, goals):
        return route
    low, size = usual.min(axis=0), np.ptp(usual, axis=0)
    places = goals.min(axis=0) + (np.array(route) - low) / size * np.ptp(goals, axis=0)
    return tuple(tuple(round(float(x), 4) for x in place) for place in places)


TASK = TaskSpec(
    name="reach",
    description="the arm's gripper goes to points in space, joint increments at 20 Hz",
    settings=ReachTask,
    environment=_environment,
    place_goal=as_typed,
    example="0.6,0.0,0.2",
    placed=("goals", "start", "action_limit"),
    place=_place,
    check_goal=check_in_reach,
    compositions={
        # Julian et al. 2018, the searched triangle
        "triangle": (((0.6, 0.3, 0.15), (0.6, -0.3, 0.15), (0.6, 0.0, 0.3), (0.6, 0.3, 0.15)),),
    },
    fit_route=_fit_route,
    chains={"u-shape": "3,4,8,7"},  # Julian et al. 2018: draws a U
)
