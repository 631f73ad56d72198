"""Place the start of the arm over the block."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.robot import Robot
from skillcli.robots.start import POINTS_DOWN, find_start
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.blocks.starts import SPREAD
from skillcli.tasks.placement import given_start, no_place

START_HEIGHT = 0.2  # m, of the gripper above the table


def place_blocks(task: BlocksTask, robot: Robot) -> dict[str, Any]:
    """Find start and action limit of the section `task` on this arm; what a recipe gives is kept.

    Raises:
        UsageError: the arm has no hand, or no room.
    """
    robot.graspers()
    x, y = task.block_start
    corners = np.array([
        (x + a * SPREAD, y + b * SPREAD, z) for a in (-1, 1) for b in (-1, 1) for z in (task.block_size / 2, START_HEIGHT)
    ])  # fmt: skip
    own = given_start(task, robot, robot.description.starts.get("blocks"))
    start = find_start(Kinematics(robot), np.array([x, y, START_HEIGHT]), corners, own, down=POINTS_DOWN)
    if start is None:
        raise no_place(robot, "blocks", "task.block_start and task.start")
    return {"start": start, "action_limit": robot.largest_action(task.action_limit, task.control_period)}
