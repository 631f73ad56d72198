"""The scene of the blocks task: a block on the table, and a hand whose two fingers hold it by friction."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.simulation.arm_environment import start_of
from skillcli.simulation.arms import CONTACT_FORCE, OBJECT
from skillcli.simulation.fingers import Fingers
from skillcli.tasks.blocks.settings import BlocksTask

# Contact. The friction cone is elliptic, condim is 4 and the table as in push. A held block creeps: the less, the larger
# impratio and the shorter the time constant of the pads, two time steps at least; docs/experiments/blocks.md has the study.
IMPRATIO = 30.0
TABLE_SOLREF, TABLE_SOLIMP = (0.01, 1.0), (0.0, 0.998, 0.003, 0.5, 1.0)
PAD_SOLREF, PAD_SOLIMP = (0.005, 1.0), (0.9, 0.99, 0.001, 0.5, 2.0)
TORSION, ROLLING = 0.005, 1e-4  # m, MuJoCo's own
NET_FORCE = 3  # mode of contact sensors that reduces several contacts to the net force

COLOURS = ([0.85, 0.55, 0.2, 1.0], [0.25, 0.55, 0.8, 1.0], [0.45, 0.7, 0.3, 1.0])

LEAD = Fingers.MAX_LEAD / 2  # m, of each finger: a closed hand then presses with `task.grip_force`
FINGER_INERTIA = 0.1  # kg, of the motor as each finger feels it behind its gear


def blocks_spec(task: BlocksTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
    """Build the arm behind its table, its fingers movable, and a block that can move freely."""
    spec = robot.arm_spec(start_of(task, robot), task.timestep, task.control_period, delay)
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPRATIO
    for index, place in enumerate((task.block_start, *task.others)):
        _add_block(spec, task, OBJECT if index == 0 else f"{OBJECT}{index + 1}", place, COLOURS[index])
    _move_fingers(spec, task, robot)
    spec.add_sensor(
        name=CONTACT_FORCE,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,  # a body and all its children: the arm
        objname=spec.joint(robot.names.joints[0]).parent.name,
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), NET_FORCE, 1],
    )
    return spec


def _add_block(spec: mujoco.MjSpec, task: BlocksTask, name: str, place: tuple[float, float], colour: list[float]) -> None:
    half = task.block_size / 2
    block = spec.worldbody.add_body(name=name, pos=[*place, TABLE_TOP + half])
    block.add_freejoint(name=name)
    block.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=np.full(3, half),
        mass=task.block_mass,
        rgba=colour,
        condim=4,
        priority=2,  # overrides the table's contact settings
        friction=[task.friction, TORSION, ROLLING],
        solref=TABLE_SOLREF,
        solimp=TABLE_SOLIMP,
    )


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
    for name in robot.names.finger:
        pad = spec.geom(name)
        pad.priority, pad.condim = 3, 4  # overrides the block's contact settings
        pad.friction, pad.solref, pad.solimp = [task.pad_friction, TORSION, ROLLING], PAD_SOLREF, PAD_SOLIMP
