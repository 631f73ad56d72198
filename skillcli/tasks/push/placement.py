"""Place the box and the start of the arm on other arms than the default one."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.robots.start import POINTS_DOWN, find_start
from skillcli.tasks.placement import given_start, no_place
from skillcli.tasks.push.settings import PushTask
from skillcli.trajectories import Array

BEHIND = 0.05  # m from a goal of the box to the finger that pushes it there
AHEAD, ABOVE = 0.05, 0.08  # m: the start of the finger, from the middle of the box's top
PLACES = tuple(float(x) for x in np.arange(0.3, 0.9, 0.05))  # m before the base: places to try for the box
PUSH_HEIGHT = 0.03  # m above the table: the height of a pushing finger


def place_push(task: PushTask, robot: Robot) -> dict[str, Any]:
    """Place box, start and action limit of the section `task` on this arm; what a recipe gives is kept.

    Raises:
        UsageError: the arm has no room.
    """
    own = given_start(task, robot, robot.description.starts.get("push"))
    given = task.box_start if "box_start" in task.model_fields_set else None
    box, start = _box_and_start(Kinematics(robot), np.array(task.goals), task.box_size[2], given, own)
    return {
        "box_start": box,
        "start": start,
        "action_limit": robot.largest_action(task.action_limit, task.control_period),
    }


def _box_and_start(
    kinematics: Kinematics, goals: Array, height: float, box: tuple[float, float] | None, own: tuple[float, ...] | None
) -> tuple[list[float], tuple[float, ...]]:

    def start_at(x: float, y: float, near: tuple[float, ...] | None) -> tuple[float, ...] | None:
        middle = np.array([x + AHEAD, y, TABLE_TOP + height + ABOVE])
        return find_start(kinematics, middle, _finger_places(goals, x, y), own, down=POINTS_DOWN, near=near)

    if box is not None:
        start = start_at(*box, None)
        if start is None:
            raise no_place(kinematics.robot, "push", "task.start")
        return list(box), start
    usual = 0.45 * kinematics.robot.workspace.reach
    for first in sorted(range(len(PLACES)), key=lambda i: abs(PLACES[i] - usual)):
        start = start_at(PLACES[first], 0.0, None)
        if start is not None:
            break
    else:
        raise no_place(kinematics.robot, "push", "task.box_start and task.start, or smaller task.goals")
    found = {first: start}
    for step in (-1, 1):  # as far as there is room to both sides: the middle leaves most
        i = first + step
        while 0 <= i < len(PLACES) and (start := start_at(PLACES[i], 0.0, found[i - step])) is not None:
            found[i], i = start, i + step
    middle = sorted(found)[len(found) // 2]
    return [round(PLACES[middle], 3), 0.0], found[middle]


def _finger_places(goals: Array, x: float, y: float) -> Array:
    """Return places that the finger must reach around a box at x, y m: a square grid around all goals, (9, 3) m."""
    half = np.abs(goals).max(axis=0) + BEHIND
    return np.array([
        (x + a * half[0], y + b * half[1], TABLE_TOP + PUSH_HEIGHT) for a, b in product((-1, 0, 1), repeat=2)
    ])  # fmt: skip
