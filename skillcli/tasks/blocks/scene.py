"""The scene of the blocks task: a block on the table, and a hand whose two fingers hold it by friction."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.simulation.arms import OBJECT
from skillcli.simulation.fingers import Fingers
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.on_table import COLOURS, add_box, add_contact_force, set_finger_contact, table_spec

# A held block creeps: the less, the larger impratio and the shorter the time constant of the pads, two time steps at least;
# docs/experiments/blocks.md has the study.
IMPRATIO = 30.0
PAD_SOLREF, PAD_SOLIMP = (0.005, 1.0), (0.9, 0.99, 0.001, 0.5, 2.0)

LEAD = Fingers.MAX_LEAD / 2  # m, of each finger: a closed hand then presses with `task.grip_force`
FINGER_INERTIA = 0.1  # kg, of the motor as each finger feels it behind its gear


def blocks_spec(task: BlocksTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
    """Build the arm behind its table, its fingers movable, and a block that can move freely."""
    spec = table_spec(task, robot, delay, IMPRATIO)
    half = np.full(3, task.block_size / 2)
    for index, place in enumerate((task.block_start, *task.others)):
        name = OBJECT if index == 0 else f"{OBJECT}{index + 1}"
        add_box(spec, name, place, half, task.block_mass, task.friction, COLOURS[index])
    _move_fingers(spec, task, robot)
    add_contact_force(spec, robot)
    return spec


def _move_fingers(spec: mujoco.MjSpec, task: BlocksTask, robot: Robot) -> None:
    """Drive both fingers by servos of the same stiffness and force, mirrored, with pads of rubber.

    The damping is such that fingers whose command leads them as far as it may move at the largest speed of the hand.
    """
    hand = robot.graspers()
    stiffness, damping = task.grip_force / LEAD, task.grip_force / (hand.speed / 2)
    for joint, servo in zip(hand.joints, hand.servos, strict=True):
        finger = spec.joint(joint)
        finger.armature = FINGER_INERTIA
        actuator = spec.actuator(servo)
        actuator.set_to_position(kp=stiffness, kv=damping)
        actuator.forcelimited, actuator.forcerange = True, [-hand.force, hand.force]
        actuator.ctrllimited, actuator.ctrlrange = True, [-LEAD, hand.widest / 2]
    spec.add_equality(
        name="mirrored",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=hand.joints[0],
        name2=hand.joints[1],
        data=[0, 1, *[0] * (mujoco.mjNEQDATA - 2)],
    )
    set_finger_contact(spec, robot, task.pad_friction, PAD_SOLREF, PAD_SOLIMP)
