"""Read a foreign model, drop its scene and whatever needs missing files, and compile it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import skillcli.robots.quiet  # noqa: F401
from skillcli.errors import UsageError
from skillcli.robots.model_size import check_size

_AT_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_PACKAGE = "package://"  # begins the names of files in URDF
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


MENAGERIE, MENAGERIE_ROOT = "menagerie:", "MENAGERIE_ROOT"


def find_model(folder: Path, name: str) -> Path:
    """Find the file of a model: a path relative to a folder, or `menagerie:NAME` in a checkout of MuJoCo Menagerie.

    Raises:
        UsageError: there is no checkout, or no such model in it.
    """
    if not name.startswith(MENAGERIE):
        return folder / name
    wanted, root = name.removeprefix(MENAGERIE), os.environ.get(MENAGERIE_ROOT, "")
    if not root or not Path(root).is_dir():
        told = f"{MENAGERIE_ROOT}={root} is no folder" if root else f"{MENAGERIE_ROOT} is not set"
        raise UsageError(
            f"model: {name} needs a checkout of MuJoCo Menagerie, and {told}",
            f"clone it, then set {MENAGERIE_ROOT} to its folder; nothing is downloaded here",
        )
    place = Path(root) / wanted
    if place.with_name(f"{place.name}.xml").is_file():
        return place.with_name(f"{place.name}.xml")
    models = sorted((path for path in place.glob("*.xml") if "scene" not in path.stem), key=lambda path: (len(path.stem), path))
    if not models:
        known = ", ".join(sorted(path.name for path in Path(root).iterdir() if path.is_dir() and list(path.glob("*.xml")))[:80])
        raise UsageError(f"model: no model {wanted!r} in {root}", f"models there: {known or 'none'}")
    return models[0]


def read_mjcf(path: Path) -> mujoco.MjSpec:
    """Read a model, and name every body.

    Raises:
        UsageError: there is no such file, or MuJoCo cannot read it.
    """
    try:
        there = path.is_file()
    except OSError:  # no name of a file
        there = False
    if not there:
        raise UsageError(f"model: no file {str(path)[:300]}", "the path is relative to the robot file")
    try:
        check_size(path)
    except OSError as error:
        raise UsageError(f"model: {path.name} cannot be read: {error.strerror or error}", "see who may read it") from None
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        expand = "expand it first: xacro FILE > arm.urdf"
        told = expand if path.suffix == ".xacro" else "MuJoCo's own XML, or a URDF, is asked for"
        raise UsageError(f"model: {path.name} cannot be read as MJCF or URDF: {_line(error)}", told) from error
    for index, body in enumerate(spec.bodies[1:]):
        body.name = body.name or f"unnamed-{index}"  # bodies are told apart by name
    for mesh in spec.meshes:
        mesh.file = _found_in_package(mesh.file, path)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False  # either could take the gripper's body or our geoms away
    return spec


def _found_in_package(file: str, path: Path) -> str:
    """A mesh `package://NAME/REST` of a URDF as a path from the URDF, where a folder above it is that package, or holds it."""
    if not file.startswith(_PACKAGE):
        return file
    name, _, rest = file.removeprefix(_PACKAGE).partition("/")
    for folder in path.absolute().parents:
        for place in (folder / rest, folder / name / rest):
            if place.is_file():
                return os.path.relpath(place, path.absolute().parent)
    return file


@contextmanager
def quietly() -> Iterator[None]:
    """Silence MuJoCo's warnings about deprecated notation and differing memory sizes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def compile_model(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile a model.

    Raises:
        UsageError: MuJoCo refuses it.
    """
    try:
        with quietly():
            return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise UsageError(
            f"model: MuJoCo cannot compile {path.name}: {_line(error)}",
            "a link whose meshes are missing needs an <inertial> of its own" if "mass" in str(error) else "fix the MJCF file",
        ) from error


LARGEST = 1e15  # of any number in a model; masses, lengths and stiffnesses of real arms are far smaller
_WRITTEN = ("dof_", "jnt_", "body_", "geom_", "site_")  # written by a person: named first in errors


def check_numbers(model: mujoco.MjModel, path: Path) -> None:
    """Refuse a model with numbers that are not finite, or absurdly large.

    Raises:
        UsageError: there are some; MuJoCo would accept them and simulate nonsense.
    """
    for name in ("dof_armature", "dof_damping", "dof_frictionloss", "jnt_stiffness"):
        if (getattr(model, name) < 0).any():
            raise UsageError(f"model: {path.name} has a negative {name.split('_')[1]} of a joint", "fix the MJCF file")
    numbers = [*_numbers(model.opt), *sorted(_numbers(model), key=lambda pair: _derived(pair[0]))]
    for name, values in numbers:
        if not (np.abs(values) < LARGEST).all():
            raise UsageError(f"model: {path.name} has a number that is not finite, or absurd, in {name}", "fix the MJCF file")


def _derived(name: str) -> bool:
    return not name.startswith(_WRITTEN) or "0" in name


def _numbers(owner: Any) -> Iterator[tuple[str, Any]]:
    """Yield all floating point numbers of a model or its options, by name."""
    for name in (name for name in dir(owner) if not name.startswith("_")):
        values = getattr(owner, name)
        if isinstance(values, float | np.ndarray) and np.asarray(values).dtype.kind == "f":
            yield name, np.asarray(values)


def drop_missing_files(spec: mujoco.MjSpec, path: Path) -> list[str]:
    """Delete textures and skins, and whatever needs a missing file; return a note of the latter."""
    for element in [*spec.skins, *spec.textures]:
        spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    missing = [
        (kind, asset)
        for kind, assets in (("mesh", spec.meshes), ("hfield", spec.hfields))
        for asset in assets
        if asset.file and not (_asset_file(spec, asset, path).is_file() and _readable(asset.file))
    ]
    if not missing or _all_there(spec):
        return []
    gone: dict[str, set[str]] = {"mesh": set(), "hfield": set()}
    for kind, asset in missing:
        gone[kind].add(asset.name or Path(asset.file).stem)
        spec.delete(asset)
    dropped = [geom for geom in spec.geoms if geom.meshname in gone["mesh"] or geom.hfieldname in gone["hfield"]]
    touching = sum(bool(geom.contype or geom.conaffinity) for geom in dropped)
    for geom in dropped:
        spec.delete(geom)
    _drop_pairs(spec)
    if not gone["mesh"]:
        return []
    why = "missing" if all(_readable(asset.file) for _, asset in missing) else "missing, or DAE, which MuJoCo does not read"
    return [f"{len(gone['mesh'])} mesh files are {why}: {len(dropped)} geoms left out, {touching} of them could touch"]


def _readable(file: str) -> bool:
    """Whether MuJoCo reads such files: meshes of a URDF are often DAE, which it does not."""
    return Path(file).suffix.lower() != ".dae"


def balance_inertia(spec: mujoco.MjSpec) -> list[str]:
    """Let MuJoCo repair inertias that no body can have, which it else refuses: often in URDF; returns a note of that."""
    wrong = [body.name for body in spec.bodies[1:] if body.explicitinertial and not _is_possible(body)]
    if not wrong or spec.compiler.balanceinertia:
        return []
    spec.compiler.balanceinertia = True
    return [f"no body can have the inertia that the model gives, so its mean about all axes is taken: {', '.join(wrong)}"]


def _is_possible(body: Any) -> bool:
    """Whether no principal moment of inertia is above the sum of the two others."""
    xx, yy, zz, xy, xz, yz = body.fullinertia
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments = np.linalg.eigvalsh(matrix) if np.isfinite(xx) else np.sort(body.inertia)
    return bool(moments[2] <= moments[0] + moments[1])


def _all_there(spec: mujoco.MjSpec) -> bool:
    """Check whether MuJoCo finds all files: it alone resolves the folders of attached models."""
    try:
        with quietly():
            spec.copy().compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        return "file" not in str(error)
    return True


def _drop_pairs(spec: mujoco.MjSpec) -> None:
    """Delete contact pairs of deleted geoms: MuJoCo deletes all other references itself, but not these."""
    left = {geom.name for geom in spec.geoms}
    for pair in list(spec.pairs):
        if not {pair.geomname1, pair.geomname2} <= left:
            spec.delete(pair)


def _asset_file(spec: mujoco.MjSpec, asset: Any, path: Path) -> Path:
    name = Path(asset.file).name if spec.strippath else str(asset.file)
    return path.parent / str(spec.meshdir) / name


def check_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Check that the joints exist, are hinges, and hang on each other in this order.

    Raises:
        UsageError: one of these does not hold.
    """
    known = {joint.name: joint for joint in spec.joints}
    for name in joints:
        if name not in known:
            raise UsageError(
                f"joints: no joint {name!r} in the model", f"joints there: {', '.join(filter(None, known)) or 'none'}"
            )
        if known[name].type != _HINGE:
            raise UsageError(f"joints: {name!r} is not a hinge", "all joints of the arm turn")
    for inner, outer in pairwise(joints):
        if known[inner].parent.name not in [body.name for body in upwards(known[outer].parent)]:
            raise UsageError(f"joints: {outer!r} does not hang on {inner!r}", "name them from the base to the hand")


def upwards(body: Any) -> Iterable[Any]:
    """Return a body and all bodies that carry it, the world last."""
    while body is not None:
        yield body
        body = body.parent


def drop_scene(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Keep only the arm's tree; its fixed parts cannot be touched, since the task has its own table."""
    for element in [*spec.keys, *spec.sensors, *spec.cameras, *spec.lights, *spec.worldbody.geoms]:
        spec.delete(element)
    root = [*upwards(spec.joint(joints[0]).parent)][-2]
    for body in list(spec.worldbody.bodies):
        if body.name != root.name:
            spec.delete(body)
    _drop_pairs(spec)
    for body in spec.bodies:
        if not any(part.joints for part in upwards(body)):
            for geom in body.geoms:
                geom.contype = geom.conaffinity = 0


def lock_loose_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> list[str]:
    """Lock extra joints that nothing in the model holds at their reference; return a note."""
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
    driven = {joint.name for joint in loose} - {""}
    for element in [*(motor for motor in spec.actuators if motor.trntype in _AT_JOINT and motor.target in driven), *loose]:
        spec.delete(element)
    return [f"joints that nothing holds are locked: {names}"] if loose else []


def _pulls_back(actuator: Any) -> bool:
    """Whether an actuator without a command holds what it drives; a motor, or a servo of speed, lets it drift."""
    kind = mujoco.mjtBias
    return actuator.biastype != kind.mjBIAS_NONE and not (actuator.biastype == kind.mjBIAS_AFFINE and actuator.biasprm[1] == 0)


def _holds(spec: mujoco.MjSpec) -> tuple[set[str], set[str]]:
    """Joints, and bodies, that an actuator, a tendon or an equality holds."""
    joints, bodies = set(), set()
    kind = mujoco.mjtEq
    sites = {site.name: site.parent.name for site in spec.sites}
    for actuator in spec.actuators:
        if not _pulls_back(actuator):
            continue
        if actuator.trntype in _AT_JOINT:
            joints.add(actuator.target)
        elif actuator.trntype == mujoco.mjtTrn.mjTRN_SITE:
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
