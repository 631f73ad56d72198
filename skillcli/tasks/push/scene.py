"""The scene of the push task: a box on the table in front of the arm, with real contact and friction."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.simulation.arm_environment import start_of
from skillcli.simulation.arms import CONTACT_FORCE, OBJECT
from skillcli.tasks.push.settings import PushTask

# Contact. The friction cone is elliptic, else friction would depend on the direction of a push. condim 4 adds the torsion that
# keeps a box from spinning under a finger. impratio makes friction stiffer than the normal force, so that a pushed box does
# not creep. Impedance rises from zero over the first millimetres, so that the outcome depends less on the exact time of a
# touch. It is stiff enough to keep the overlap below 3 mm, and no stiffer, since the outcome then depends more on the time
# step; docs/experiments/push.md has the study.
IMPRATIO = 10.0
TABLE_SOLREF, TABLE_SOLIMP = (0.01, 1.0), (0.0, 0.998, 0.003, 0.5, 1.0)
FINGER_SOLREF, FINGER_SOLIMP = (0.01, 1.0), (0.0, 0.998, 0.002, 0.5, 1.0)
TORSION, ROLLING = 0.005, 1e-4  # m, MuJoCo's own
NET_FORCE = 3  # mode of contact sensors that reduces several contacts to the net force


def push_spec(task: PushTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
    """Build the arm behind its table, and a box that can move freely."""
    robot.check_finger()
    spec = robot.arm_spec(start_of(task, robot), task.timestep, task.control_period, delay)
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPRATIO
    half = np.array(task.box_size) / 2
    box = spec.worldbody.add_body(name=OBJECT, pos=[*task.box_start, TABLE_TOP + half[2]])
    box.add_freejoint(name=OBJECT)
    box.add_geom(
        name=OBJECT,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        mass=task.box_mass,
        rgba=[0.85, 0.55, 0.2, 1],
        condim=4,
        priority=2,  # overrides the table's contact settings
        friction=[task.friction, TORSION, ROLLING],
        solref=TABLE_SOLREF,
        solimp=TABLE_SOLIMP,
    )
    spec.add_sensor(
        name=CONTACT_FORCE,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,  # a body and all its children: the arm
        objname=spec.joint(robot.names.joints[0]).parent.name,
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), NET_FORCE, 1],
    )
    for name in robot.names.finger:
        finger = spec.geom(name)
        finger.priority, finger.condim = 3, 4  # overrides the box's contact settings
        finger.friction, finger.solref, finger.solimp = [task.friction, TORSION, ROLLING], FINGER_SOLREF, FINGER_SOLIMP
    return spec
