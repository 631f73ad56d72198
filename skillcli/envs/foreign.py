"""A foreign arm out of its MJCF: alone, without the scene it came in, driven by seven position servos, behind our table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from skillcli.envs import sawyer
from skillcli.envs.description import Description, Gripper
from skillcli.envs.servos import Servo, add_servo, find_servos
from skillcli.errors import UsageError

PREFIX = "robot/"  # of all names of the foreign model, so that none is one of ours
# Flags of a model that would switch off what a task needs, and one that would hide an unstable simulation.
_NEEDED = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_AUTORESET = mujoco.mjtDisableBit.mjDSBL_AUTORESET
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


def build(path: Path, description: Description) -> tuple[mujoco.MjSpec, sawyer.Names, list[Servo], list[str]]:
    """The foreign arm behind our table: the scene, what it calls its parts, its servos, and notes of what was left out.

    Args:
        path: of the MJCF file.
        description: of the robot.

    Raises:
        UsageError: the model does not fit the description, or cannot be simulated.
    """
    child = _read(path)
    notes = _drop_missing_files(child, path)
    _check_joints(child, description.joints)
    _drop_scene(child, description.joints)
    notes += _lock_loose_joints(child, description.joints)
    model = compile_model(child, path)
    if notes and not (model.geom_contype | model.geom_conaffinity)[model.body_weldid[model.geom_bodyid] > 0].any():
        raise UsageError("model: nothing of the arm is left that can touch anything", f"{notes[0]}; put the files there")
    servos, replaced = find_servos(model, description.joints, description.actuators, description.gains)
    holder, pos, quat = _gripper_frame(child, model, description.gripper)
    geoms = None if description.finger is None else _finger_geoms(child, description.finger)
    for index in sorted(replaced, reverse=True):
        child.delete(child.actuators[index])
    _compensate(child, description)
    scene = _mount(child, description, servos)
    _put_finger(scene.body(PREFIX + holder), pos, quat, own=geoms is not None, default=scene.default)
    finger = sawyer.NAMES.finger if geoms is None else tuple(PREFIX + name for name in geoms)
    names = sawyer.Names(tuple(PREFIX + name for name in description.joints), sawyer.NAMES.servos, finger)
    return scene, names, servos, notes


def _read(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise UsageError(f"model: no file {path}", "the path is relative to the robot file")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise UsageError(f"model: {path.name} is not MJCF: {_line(error)}", "MuJoCo's own XML is asked for") from error
    spec.compiler.fusestatic = spec.compiler.discardvisual = False  # either could take the gripper's body or our geoms away
    return spec


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def compile_model(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model.

    Raises:
        UsageError: MuJoCo refuses it.
    """
    try:
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise UsageError(
            f"model: MuJoCo cannot compile {path.name}: {_line(error)}",
            "a link whose meshes are missing needs an <inertial> of its own" if "mass" in str(error) else "mend the MJCF",
        ) from error


def _drop_missing_files(spec: mujoco.MjSpec, path: Path) -> list[str]:
    """Leave out what is only for the eye, and whatever needs a file that is not there."""
    for element in [*spec.skins, *spec.textures]:
        spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    gone = {"mesh": set(), "hfield": set()}  # type: dict[str, set[str]]
    for kind, assets in (("mesh", spec.meshes), ("hfield", spec.hfields)):
        for asset in list(assets):
            if asset.file and not _asset_file(spec, asset, path).is_file():
                gone[kind].add(asset.name or Path(asset.file).stem)
                spec.delete(asset)
    dropped = [geom for geom in spec.geoms if geom.meshname in gone["mesh"] or geom.hfieldname in gone["hfield"]]
    touching = sum(bool(geom.contype or geom.conaffinity) for geom in dropped)
    for geom in dropped:
        spec.delete(geom)
    if not gone["mesh"]:
        return []
    return [f"{len(gone['mesh'])} mesh files are missing: {len(dropped)} geoms left out, {touching} of them could touch"]


def _asset_file(spec: mujoco.MjSpec, asset: Any, path: Path) -> Path:
    name = Path(asset.file).name if spec.strippath else asset.file
    return path.parent / spec.meshdir / name


def _check_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    known = {joint.name: joint for joint in spec.joints}
    for name in joints:
        if name not in known:
            raise UsageError(
                f"joints: no joint {name!r} in the model", f"joints there: {', '.join(filter(None, known)) or 'none'}"
            )
        if known[name].type != _HINGE:
            raise UsageError(f"joints: {name!r} is not a hinge", "the arm has seven joints that turn")
    for inner, outer in pairwise(joints):
        if known[inner].parent.name not in [body.name for body in _upwards(known[outer].parent)]:
            raise UsageError(f"joints: {outer!r} does not hang on {inner!r}", "name the seven from the base to the hand")


def _upwards(body: Any) -> Iterable[Any]:
    """A body and all that carry it, the world last."""
    while body is not None:
        yield body
        body = body.parent


def _drop_scene(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Keep the tree that the arm stands in; what does not move in it cannot be touched: the task has its own table."""
    for element in [*spec.keys, *spec.sensors, *spec.cameras, *spec.lights, *spec.worldbody.geoms]:
        spec.delete(element)
    root = [*_upwards(spec.joint(joints[0]).parent)][-2]
    for body in list(spec.worldbody.bodies):
        if body.id != root.id or body.name != root.name:
            spec.delete(body)
    for body in spec.bodies:
        if not any(part.joints for part in _upwards(body)):
            for geom in body.geoms:
                geom.contype = geom.conaffinity = 0


def _lock_loose_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> list[str]:
    """Weld the extra joints that nothing in the model holds, where they stand at their reference."""
    named, bodies = _holds(spec)
    loose = []
    for joint in list(spec.joints):
        if joint.name in joints:
            continue
        below = [joint.parent, *joint.parent.find_all("body")]
        carries_arm = any(part.name in joints for body in below for part in body.joints)
        held = joint.name in named or any(joint.stiffness) or (not carries_arm and any(body.name in bodies for body in below))
        if not (held and joint.type in (_HINGE, _SLIDE)):
            loose.append(joint)
    names = ", ".join(joint.name or "unnamed" for joint in loose)
    for joint in loose:
        spec.delete(joint)
    return [f"joints that nothing holds are locked: {names}"] if loose else []


def _holds(spec: mujoco.MjSpec) -> tuple[set[str], set[str]]:
    """Joints, and bodies, that an actuator, a tendon or an equality acts on."""
    joints, bodies = set(), set()
    transmission, kind = mujoco.mjtTrn, mujoco.mjtEq
    sites = {site.name: site.parent.name for site in spec.sites}
    for actuator in spec.actuators:
        if actuator.trntype in (transmission.mjTRN_JOINT, transmission.mjTRN_JOINTINPARENT):
            joints.add(actuator.target)
        elif actuator.trntype == transmission.mjTRN_SITE:
            bodies.add(sites.get(actuator.target, ""))
    for tendon in spec.tendons:
        for wrap in tendon.path:
            if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT:
                joints.add(wrap.target.name)
            elif wrap.type == mujoco.mjtWrap.mjWRAP_SITE:
                bodies.add(wrap.target.parent.name)
    for equality in spec.equalities:
        ends = {equality.name1, equality.name2} - {""}
        if equality.type == kind.mjEQ_JOINT:
            joints |= ends
        elif equality.type in (kind.mjEQ_CONNECT, kind.mjEQ_WELD):
            bodies |= {sites.get(end, end) for end in ends}
    return joints - {""}, bodies - {""}


def _gripper_frame(spec: mujoco.MjSpec, model: mujoco.MjModel, gripper: Gripper) -> tuple[str, list[float], list[float]]:
    """The gripper's body, and its pose there."""
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
    found.parent.name = found.parent.name or "hand"
    site = model.site(gripper.site)
    return found.parent.name, site.pos.tolist(), site.quat.tolist()


def _finger_geoms(spec: mujoco.MjSpec, names: Sequence[str]) -> list[str]:
    """Names of the geoms that push, made able to touch."""
    geoms = []
    for name in names:
        body, geom = spec.body(name), spec.geom(name)
        if geom is None and body is None:
            known = ", ".join(geom.name for geom in spec.geoms if geom.name)
            raise UsageError(f"finger: neither a geom nor a body {name!r} in the arm", f"geoms there: {known or 'none'}")
        found = [geom] if geom is not None else [part for part in body.geoms if part.contype or part.conaffinity]
        if not found:
            raise UsageError(f"finger: body {name!r} has no geom that can touch", "name geoms, or leave `finger` out for ours")
        geoms += found
    for index, geom in enumerate(geoms):
        geom.name = geom.name or f"finger{index}"
        geom.contype, geom.conaffinity = geom.contype | 1, geom.conaffinity | 1
    return [geom.name for geom in geoms]


def _compensate(spec: mujoco.MjSpec, description: Description) -> None:
    wanted = description.gravity_compensation
    if wanted is None and description.gains is not None:
        wanted = True  # then the controller is ours, and ours carries the arm
    if wanted is not None:
        for body in spec.bodies[1:]:
            body.gravcomp = float(wanted)


def _mount(child: mujoco.MjSpec, description: Description, servos: list[Servo]) -> mujoco.MjSpec:
    """A scene of our own with the table, the arm on its base, and the servos as its first controls."""
    scene = mujoco.MjSpec()
    scene.compiler.degree = False
    for field in (name for name in dir(child.option) if not name.startswith("_")):
        setattr(scene.option, field, getattr(child.option, field))
    scene.option.jacobian = child.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # see models/sawyer.xml
    flags = int(child.option.disableflags) & ~int(_NEEDED) | int(_AUTORESET)
    scene.option.disableflags = child.option.disableflags = flags
    scene.option.enableflags = child.option.enableflags = 0
    scene.option.disableactuator = child.option.disableactuator = 0
    sawyer.add_table(scene)
    for name, servo in zip(sawyer.NAMES.servos, servos, strict=True):
        add_servo(scene, name, PREFIX + servo.joint, servo)
    frame = scene.worldbody.add_frame(pos=description.base.pos, quat=description.base.quat)
    scene.attach(child, prefix=PREFIX, frame=frame)
    return scene


def _put_finger(hand: Any, pos: list[float], quat: list[float], own: bool, default: Any) -> None:
    """Mark the tip of the arm's own finger, or mount ours, as the site that tasks judge."""
    if own:
        hand.add_site(default, name=sawyer.GRIPPER, pos=pos, quat=quat)
        return
    ours = mujoco.MjSpec.from_file(str(sawyer.MODEL_FILE)).body("finger")
    body = hand.add_body(default, name="finger", pos=pos, quat=quat, gravcomp=hand.gravcomp)
    for geom in ours.geoms:
        shape = {key: np.copy(getattr(geom, key)) for key in ("size", "fromto", "rgba")}
        body.add_geom(default, name=geom.name, type=geom.type, mass=geom.mass, group=geom.group, **shape)
    for site in ours.sites:
        body.add_site(default, name=site.name, pos=np.copy(site.pos), size=np.copy(site.size))
