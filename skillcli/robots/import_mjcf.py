"""Import a foreign arm: alone behind our table, driven by position servos, with a finger."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.config import Description, Gripper
from skillcli.robots.match import Source, check_build
from skillcli.robots.mjcf import (
    balance_inertia,
    check_joints,
    check_numbers,
    compile_model,
    drop_missing_files,
    drop_scene,
    lock_loose_joints,
    read_mjcf,
    upwards,
)
from skillcli.robots.scene import GRIPPER, Names, add_table
from skillcli.robots.servos import Servo, add_servo, find_servos, lay_on_joint

FINGER_FILE = Path(__file__).parent / "finger.xml"
OUR_FINGER = ("palm", "rod")
PREFIX = "robot/"  # of all names of the foreign model, so that none clashes with ours
# Flags of a model that would switch off what a task needs, and one that would hide an unstable simulation.
_NEEDED = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_AUTORESET = mujoco.mjtDisableBit.mjDSBL_AUTORESET


def build(path: Path, description: Description, source: Source | None) -> tuple[mujoco.MjSpec, Names, list[Servo], list[str]]:
    """Build the scene with a foreign arm; return it with the names of its parts, its servos, and notes of what was changed.

    Args:
        path: of the MJCF file.
        description: of the robot.
        source: the arm whose skills it is to play, if any; it must be of the same build.

    Raises:
        UsageError: the model does not fit the description, or cannot be simulated.
    """
    child = read_mjcf(path)
    missing = drop_missing_files(child, path)
    balanced = balance_inertia(child)
    check_joints(child, description.joints)
    drop_scene(child, description.joints)
    locked = lock_loose_joints(child, description.joints)
    model = compile_model(child, path)
    check_numbers(model, path)
    if source is not None:
        check_build(model, description.joints, source)
    if missing and not (model.geom_contype | model.geom_conaffinity).any():
        raise UsageError(
            "model: nothing is left of the arm that can touch anything", f"{missing[0]}; put the files where the model says"
        )
    servos, replaced = find_servos(model, description.joints, description.actuators, description.gains)
    holder, pos, quat = _gripper_frame(child, model, description)
    geoms = None if description.finger is None else _finger_geoms(child, description)
    for index in sorted(replaced, reverse=True):
        child.delete(child.actuators[index])
    weightless = _weigh(child)
    _compensate(child, description, carried=bool(weightless))
    scene = _mount(child, description, servos)
    _put_finger(scene.body(PREFIX + holder), pos, quat, own=geoms is not None, default=scene.default)
    finger = OUR_FINGER if geoms is None else tuple(PREFIX + name for name in geoms)
    names = Names(tuple(PREFIX + name for name in description.joints), _servo_names(servos), finger)
    weighed = ["settotalmass is not applied: the masses are those of the links"] if child.compiler.settotalmass > 0 else []
    return scene, names, servos, missing + balanced + locked + weighed + weightless


def _gripper_frame(
    spec: mujoco.MjSpec, model: mujoco.MjModel, description: Description
) -> tuple[str, list[float], list[float]]:
    """Return the body of the gripper, and the pose in it: position (3,) m and quaternion (4,)."""
    holder, pos, quat = _place_on_body(spec, model, description.gripper)
    last = description.joints[-1]
    if spec.joint(last).parent.name not in [body.name for body in upwards(spec.body(holder))]:
        raise UsageError(f"gripper: {holder!r} does not move with {last!r}", "it must hang on the last joint")
    return holder, pos, quat


def _place_on_body(spec: mujoco.MjSpec, model: mujoco.MjModel, gripper: Gripper) -> tuple[str, list[float], list[float]]:
    if gripper.body:
        known = [body.name for body in spec.bodies[1:]]
        if gripper.body not in known:
            raise UsageError(
                f"gripper.body: no body {gripper.body!r} in the arm", f"bodies there: {', '.join(filter(None, known))}"
            )
        return gripper.body, list(gripper.pos), list(gripper.quat)
    found = spec.site(gripper.site)
    if found is None:
        known = [site.name for site in spec.sites if site.name]
        raise UsageError(
            f"gripper.site: no site {gripper.site!r} in the arm",
            f"sites there: {', '.join(known) or 'none'}; or give body, pos and quat",
        )
    site = model.site(gripper.site)
    return found.parent.name, site.pos.tolist(), site.quat.tolist()


def _finger_geoms(spec: mujoco.MjSpec, description: Description) -> list[str]:
    """Make the geoms that push able to touch, and return their names."""
    geoms = []
    hand = spec.joint(description.joints[-1]).parent.name
    for name in description.finger or ():
        body, geom = spec.body(name), spec.geom(name)
        if geom is None and body is None:
            known = ", ".join(geom.name for geom in spec.geoms if geom.name)
            raise UsageError(f"finger: neither a geom nor a body {name!r} in the arm", f"geoms there: {known or 'none'}")
        found = [geom] if geom is not None else [part for part in body.geoms if part.contype or part.conaffinity]
        if not found:
            raise UsageError(f"finger: body {name!r} has no geom that can touch", "name geoms, or leave `finger` out for ours")
        if hand not in [carrier.name for carrier in upwards(found[0].parent)]:
            raise UsageError(
                f"finger: {name!r} does not move with {description.joints[-1]!r}", "what pushes must hang on the last joint"
            )
        geoms += found
    taken = {geom.name for geom in spec.geoms}
    free = (name for name in (f"finger{index}" for index in count()) if name not in taken)
    for geom in geoms:
        geom.name = geom.name or next(free)
        geom.contype, geom.conaffinity = geom.contype | 1, geom.conaffinity | 1
    return [geom.name for geom in geoms]


def _weigh(spec: mujoco.MjSpec) -> list[str]:
    """Add gravity to a model without it, else a box would not lie on the table; return a note."""
    off = mujoco.mjtDisableBit.mjDSBL_GRAVITY
    if not int(spec.option.disableflags) & int(off) and np.any(spec.option.gravity):
        return []
    spec.option.disableflags = int(spec.option.disableflags) & ~int(off)
    spec.option.gravity = mujoco.MjSpec().option.gravity
    return ["the model has no gravity: ours acts, and the arm is carried unless gravity_compensation says no"]


def _compensate(spec: mujoco.MjSpec, description: Description, carried: bool) -> None:
    """Set gravity compensation as the file says; if it does not, on with gains, or where gravity was added (`carried`)."""
    wanted = description.gravity_compensation
    if wanted is None and (carried or description.gains is not None):
        wanted = True  # with gains the controller is ours, and ours carries the arm
    if wanted is not None:
        for body in spec.bodies[1:]:
            body.gravcomp = float(wanted)


def _mount(child: mujoco.MjSpec, description: Description, servos: list[Servo]) -> mujoco.MjSpec:
    """Attach the arm to a scene with our table; its servos are the first controls."""
    scene = mujoco.MjSpec()
    scene.compiler.degree = False
    for field in (name for name in dir(child.option) if not name.startswith("_")):
        setattr(scene.option, field, getattr(child.option, field))
    scene.option.jacobian = child.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # see sawyer/sawyer.xml
    flags = int(child.option.disableflags) & ~int(_NEEDED) | int(_AUTORESET)
    scene.option.disableflags = child.option.disableflags = flags
    scene.option.enableflags = child.option.enableflags = 0
    scene.option.disableactuator = child.option.disableactuator = 0
    child.memory = scene.memory  # else the two would be reported to disagree
    add_table(scene)
    for name, servo in zip(_servo_names(servos), servos, strict=True):
        add_servo(scene, name, PREFIX + servo.joint, servo)
        lay_on_joint(child.joint(servo.joint), servo)
    frame = scene.worldbody.add_frame(pos=description.base.pos, quat=description.base.quat)
    scene.attach(child, prefix=PREFIX, frame=frame)
    return scene


def _servo_names(servos: list[Servo]) -> tuple[str, ...]:
    return tuple(f"servo{index}" for index in range(len(servos)))


def _put_finger(hand: Any, pos: list[float], quat: list[float], own: bool, default: Any) -> None:
    """Add the site `gripper` at the tip of the arm's own finger, or mount ours, which has it."""
    if own:
        hand.add_site(default, name=GRIPPER, pos=pos, quat=quat)
        return
    ours = mujoco.MjSpec.from_file(str(FINGER_FILE)).body("finger")
    body = hand.add_body(default, name="finger", pos=pos, quat=quat, gravcomp=hand.gravcomp)
    for geom in ours.geoms:
        shape = {key: np.copy(getattr(geom, key)) for key in ("size", "fromto", "rgba")}
        body.add_geom(default, name=geom.name, type=geom.type, mass=geom.mass, group=geom.group, **shape)
    for site in ours.sites:
        body.add_site(default, name=site.name, pos=np.copy(site.pos), size=np.copy(site.size))
