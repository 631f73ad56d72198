"""Place the cuboid of goals on other arms than the default one."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.robot import Robot
from skillcli.robots.start import find_start
from skillcli.tasks.placement import ROOM, SCALES, given_start, no_place, relative_reach
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

DISTANCES = (0.45, 0.4, 0.5, 0.35, 0.55, 0.3)  # of the cuboid's middle from the base, as shares of the arm's reach
BASE_GAP = 0.03  # m between the column of the base and the nearest goal


def place_reach(task: ReachTask, robot: Robot) -> dict[str, Any]:
    """Place goals, start and action limit of the section `task` on this arm; what a recipe gives is kept.

    Raises:
        UsageError: the arm has no room.
    """
    own = given_start(task, robot, robot.description.starts.get("reach", robot.description.start))
    goals, start = _goals_and_start(Kinematics(robot), own, task.goals if "goals" in task.model_fields_set else None)
    return {
        "goals": [[round(float(x), 3) for x in goal] for goal in goals],
        "start": list(start),
        "action_limit": robot.largest_action(task.action_limit, task.control_period),
    }


def _goals_and_start(kinematics: Kinematics, own: Any, given: Any) -> tuple[Array, tuple[float, ...]]:
    robot = kinematics.robot
    if given is not None:
        goals = np.array(given, dtype=float)
        start = tuple(own) if own else find_start(kinematics, goals.mean(axis=0), goals, None)
        if start is None:
            raise no_place(robot, "reach", "task.start")
        return goals, start
    usual = np.array(ReachTask.model_fields["goals"].default)
    distances = [distance * robot.workspace.reach for distance in DISTANCES]
    if own:
        distances.insert(0, float(kinematics.gripper(np.array(own))[0][0]))  # around the arm's own start
    for scale in SCALES:
        for distance in distances:
            goals = _cuboid(usual, scale * min(1.0, relative_reach(robot)), distance)
            middle = goals.mean(axis=0)
            if goals[:, 0].min() < robot.workspace.base_radius + BASE_GAP:
                continue
            start = find_start(kinematics, middle, middle + ROOM * (goals - middle), own)
            if start is not None:
                return goals, start
    raise no_place(robot, "reach", "task.goals and task.start")


def _cuboid(usual: Array, scale: float, distance: float) -> Array:
    """Return the usual goals, scaled about the origin, with their middle a distance in m in front of the base, (K, 3) m."""
    goals = scale * usual
    goals[:, 0] += distance - goals[:, 0].mean()
    return goals
