"""Boxes on the table with real contact and friction, shared by the tasks that move them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_CENTRE, TABLE_HALF_SIZE, TABLE_TOP
from skillcli.simulation.arm_environment import start_of
from skillcli.simulation.arms import CONTACT_FORCE
from skillcli.simulation.settings import ArmTask
from skillcli.tasks.goals import listed
from skillcli.trajectories import Array

# The friction cone is elliptic, else friction would depend on the direction of a push. condim 4 adds the torsion that keeps a
# box from spinning under a finger. impratio makes friction stiffer than the normal force, so that a box does not creep.
# Impedance rises from zero over the first millimetres, so that the outcome depends less on the exact time of a touch. It is
# stiff enough to keep the overlap below 3 mm, and no stiffer, since the outcome then depends more on the time step;
# docs/experiments/push.md has the study.
TABLE_SOLREF, TABLE_SOLIMP = (0.01, 1.0), (0.0, 0.998, 0.003, 0.5, 1.0)
CONDIM = 4
TORSION, ROLLING = 0.005, 1e-4  # m, MuJoCo's own
BOX_PRIORITY, FINGER_PRIORITY = 2, 3  # whose contact settings count: the finger's, then the box's, then the table's
NET_FORCE = 3  # mode of contact sensors that reduces several contacts to the net force
COLOURS = ([0.85, 0.55, 0.2, 1.0], [0.25, 0.55, 0.8, 1.0], [0.45, 0.7, 0.3, 1.0])


def table_spec(task: ArmTask, robot: Robot, delay: bool, impratio: float) -> mujoco.MjSpec:
    """Build the arm behind its table, with contact for boxes."""
    spec = robot.arm_spec(start_of(task, robot), task.timestep, task.control_period, delay)
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = impratio
    return spec


def add_box(
    spec: mujoco.MjSpec, name: str, place: Sequence[float], half: Array, mass: float, friction: float, colour: list[float]
) -> None:
    """Add a box with half edges (3,) m that lies at a place (2,) m of the table and can move freely."""
    box = spec.worldbody.add_body(name=name, pos=[*place, TABLE_TOP + half[2]])
    box.add_freejoint(name=name)
    box.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        mass=mass,
        rgba=colour,
        condim=CONDIM,
        priority=BOX_PRIORITY,
        friction=[friction, TORSION, ROLLING],
        solref=TABLE_SOLREF,
        solimp=TABLE_SOLIMP,
    )


def add_contact_force(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add the sensor of the net force on whatever touches the arm."""
    spec.add_sensor(
        name=CONTACT_FORCE,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,  # a body and all its children: the arm
        objname=spec.joint(robot.names.joints[0]).parent.name,
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), NET_FORCE, 1],
    )


def set_finger_contact(
    spec: mujoco.MjSpec, robot: Robot, friction: float, solref: Sequence[float], solimp: Sequence[float]
) -> None:
    """Give the geoms that push contact settings of their own, which count before those of a box."""
    for name in robot.names.finger:
        finger = spec.geom(name)
        finger.priority, finger.condim = FINGER_PRIORITY, CONDIM
        finger.friction, finger.solref, finger.solimp = [friction, TORSION, ROLLING], solref, solimp


def room_on_table(margin: float) -> tuple[Array, Array]:
    """Return the lowest and highest place on the table that is so far from its rim, m, (2,) m each."""
    room = np.array(TABLE_HALF_SIZE[:2]) - margin
    return TABLE_CENTRE - room, TABLE_CENTRE + room


def check_goal_on_table(goal: str, thing: str, place: Array, margin: float, hint: str, zero: Sequence[float] = (0, 0)) -> None:
    """Refuse a goal at a place (2,) m with no room for an object.

    Args:
        goal: what a typed goal is, for the message.
        thing: the object.
        place: (2,) m.
        margin: how far the middle of the object must be from the rim of the table, m.
        hint: of the message, with `{low}` and `{high}` for the lowest and highest goal.
        zero: (2,) m, the place from which goals are typed.

    Raises:
        UsageError: there is none.
    """
    lowest, highest = room_on_table(margin)
    if ((place < lowest) | (place > highest)).any():
        raise UsageError(
            f"{goal} {listed(place - zero)} leaves no room for the {thing} on the table",
            hint.format(low=listed(lowest - zero), high=listed(highest - zero)),
        )


def check_start_on_table(what: str, start: Sequence[float], margin: float, low: float, high: float) -> None:
    """Refuse an object that may start off the table, drawn from `low` to `high` m off its nominal start (2,) m.

    Raises:
        UsageError: it may; `what` names the object and its key.
    """
    (lowest, highest), place = room_on_table(margin), np.array(start)
    if not ((lowest <= place + low) & (place + high <= highest)).all():
        drawn = f", drawn {low:g} to {high:g} m off," if high > low else ""
        raise UsageError(
            f"{what} {listed(place)}{drawn} starts off the table",
            f"there is room for it at {listed(lowest)} .. {listed(highest)} m",
        )
