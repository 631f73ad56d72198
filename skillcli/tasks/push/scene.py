"""The scene of the push task: a box on the table in front of the arm, with real contact and friction."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.simulation.arms import OBJECT
from skillcli.tasks.on_table import COLOURS, add_box, add_contact_force, set_finger_contact, table_spec
from skillcli.tasks.push.settings import PushTask

IMPRATIO = 10.0
FINGER_SOLREF, FINGER_SOLIMP = (0.01, 1.0), (0.0, 0.998, 0.002, 0.5, 1.0)


def push_spec(task: PushTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
    """Build the arm behind its table, and a box that can move freely."""
    robot.check_finger()
    spec = table_spec(task, robot, delay, IMPRATIO)
    add_box(spec, OBJECT, task.box_start, np.array(task.box_size) / 2, task.box_mass, task.friction, COLOURS[0])
    add_contact_force(spec, robot)
    set_finger_contact(spec, robot, task.friction, FINGER_SOLREF, FINGER_SOLIMP)
    return spec
