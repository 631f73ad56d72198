"""Poses of the bodies of a MuJoCo model, which geoms to draw of each, and their shapes as primitives, without a viewer."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from skillcli.errors import SkillError
from skillcli.trajectories import Array

BOX_JOINT = "box"
LAST_VISUAL_GROUP = 2  # by MuJoCo's convention the groups above hold geoms for collision only

_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}
_FLAT = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)  # never drawn: endless, or a landscape


class Shape(NamedTuple):
    """One geom in the frame of its body."""

    form: str  # "capsule" | "cylinder" | "box" | "ellipsoid"
    size: Array  # (3,) m: half sizes; capsule and cylinder: radius, half length along z, 0
    position: Array  # (3,) m
    quaternion: Array  # (4,) x y z w
    rgba: Array  # (4,) in 0..1


def xyzw(wxyz: Array) -> Array:
    """Convert quaternions from MuJoCo's order, scalar first, to scalar last. (..., 4) → (..., 4)."""
    return np.roll(wxyz, -1, axis=-1)


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the body's name, or its number if it has none."""
    return str(model.body(body).name) or f"body_{body}"


def moves(model: mujoco.MjModel, body: int) -> bool:
    """Return whether any joint can move the body."""
    return int(model.body_weldid[body]) != 0


def of_arm(model: mujoco.MjModel, joints: tuple[str, ...], body: int) -> bool:
    """Return whether the body belongs to the arm with these joints, from its base on."""
    return int(model.body_rootid[body]) == int(model.body_rootid[model.joint(joints[0]).bodyid[0]])


def drawn_geoms(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Return the geoms to draw of each body that has some.

    Of a body these are what it has in visual groups; a body with collision geoms only is drawn by these. Some models keep
    collision geoms in a low group, beside visual meshes in another one where nothing collides: those are left out.
    """
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    dressing = set(range(LAST_VISUAL_GROUP + 1)) - {int(group) for group in model.geom_group[collides]}
    found: dict[int, list[int]] = {}
    for body in range(model.nbody):
        geoms = [geom for geom in np.flatnonzero(model.geom_bodyid == body) if model.geom_type[geom] not in _FLAT]
        visual = [geom for geom in geoms if model.geom_group[geom] <= LAST_VISUAL_GROUP]
        dress = [geom for geom in visual if model.geom_group[geom] in dressing]
        whole = any(model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH for geom in dress)
        chosen = [int(geom) for geom in (dress if whole else visual or geoms) if geom_color(model, int(geom))[3] > 0]
        if chosen:
            found[body] = chosen
    return found


def shapes(model: mujoco.MjModel) -> dict[int, list[Shape]]:
    """Return the primitives to draw of each body that has some; for its meshes see `meshes`."""
    found: dict[int, list[Shape]] = {}
    for body, geoms in drawn_geoms(model).items():
        primitives = [_shape(model, geom) for geom in geoms if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH]
        if primitives:
            found[body] = primitives
    return found


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    size, form = np.array(model.geom_size[geom]), mujoco.mjtGeom(model.geom_type[geom])
    if form == mujoco.mjtGeom.mjGEOM_SPHERE:
        size = np.repeat(size[:1], 3)
    turned = xyzw(np.array(model.geom_quat[geom]))
    return Shape(_SHAPES[form], size, np.array(model.geom_pos[geom]), turned, geom_color(model, geom))


def geom_color(model: mujoco.MjModel, geom: int) -> Array:
    """Return the colour of a geom, (4,); a material overrides the geom's own colour, as in MuJoCo's viewer."""
    material = int(model.geom_matid[geom])
    return np.array(model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom])


def body_poses(
    model: mujoco.MjModel,
    joints: tuple[str, ...],
    joint_position: Array,
    object_poses: Array | None = None,
    fingers: tuple[str, ...] = (),
    finger_position: Array | None = None,
) -> tuple[Array, Array]:
    """Compute the poses of all bodies for a sequence of arm postures.

    Args:
        model: of the scene, with a free joint `box` if there are object poses, and those of further objects behind it.
        joints: names of the arm's joints in the model.
        joint_position: (n, joints) rad.
        object_poses: (n, 7K) m and w x y z of K objects, or None.
        fingers: names of the slide joints of a hand.
        finger_position: (n, 2) m, how far each is open; None leaves them closed.

    Returns:
        Positions (n, bodies, 3) m and quaternions (n, bodies, 4) x y z w, in the frame of the world.
    """
    data = mujoco.MjData(model)
    arm = [_address(model, name) for name in joints]
    slides = [] if finger_position is None else [_address(model, name) for name in fingers]
    box = 0 if object_poses is None else _address(model, BOX_JOINT)
    positions = np.empty((len(joint_position), model.nbody, 3))
    quaternions = np.empty((len(joint_position), model.nbody, 4))
    for row, posture in enumerate(joint_position):
        data.qpos[arm] = posture
        if finger_position is not None and slides:
            data.qpos[slides] = finger_position[row]
        if object_poses is not None:
            data.qpos[box : box + object_poses.shape[1]] = object_poses[row]
        mujoco.mj_kinematics(model, data)
        positions[row], quaternions[row] = data.xpos, xyzw(data.xquat)
    return positions, quaternions


def _address(model: mujoco.MjModel, joint: str) -> int:
    """Return the index of the joint's position in the state."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if index < 0:
        names = ", ".join(repr(str(model.joint(i).name)) for i in range(model.njnt))
        raise SkillError(f"the robot model has no joint {joint!r}", f"its joints are {names}")
    return int(model.jnt_qposadr[index])


def z_axis(quaternion: Array) -> Array:
    """Return the z axis of rotated shapes. (n, 4) x y z w → (n, 3)."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
