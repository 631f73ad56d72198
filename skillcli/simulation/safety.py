"""Safety limits of a real arm and its cell: joint ranges, joint speeds, the table, and the box on it.

They are checked at the end of control steps. Tolerances allow for the soft joint stops and soft contacts of the simulation,
which a real arm does not have.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from skillcli.trajectories import Array

# rad beyond a joint's range: joint stops are soft, and yield by less than this to a servo that only leans on them.
RANGE_TOLERANCE = 0.005

# m. Contacts are soft, so a finger that rests on the table sinks in a little. These limits bound the overlap, not the force,
# which depends on the softness of the contact. MuJoCo's own contact is stiff: 0.05 mm is about 30 N on the fingertip. The
# contact of the push task is softer: 1 mm is about 45 N, 1.3 mm about 120 N. Skills avoid the table where they were trained;
# a higher or tilted table they may brush.
STIFF_TABLE_TOLERANCE = 5e-5
SOFT_TABLE_TOLERANCE = 2e-3

# m that a box may be pressed into the table; the contact of the push task is tuned to stay below. With four corners on the
# table 2.5 mm is about 120 N on the default box, 2.85 mm 600 N: beyond, it is rammed down.
BOX_TOLERANCE = 3e-3

# Cosine of the largest tilt of a box: beyond 45° a cube topples and its final position is unpredictable.
UPRIGHT = math.cos(math.radians(45))


class Cover:
    """Spheres that cover an arm.

    Every geom of the arm that can collide is covered by points with a radius: capsules and spheres by spheres along their
    axes, boxes by their corners, cylinders by their rims, other geoms by the corners of their bounding box. The deepest point
    below a plane is never missed; a small object may fit between corners and rims.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        geoms = [geom for geom in range(model.ngeom) if _is_arm(model, geom)]
        covers = [_cover(model, geom) for geom in geoms]
        self._points = np.concatenate([np.zeros((0, 3)), *(points for points, _ in covers)])
        self._owners = np.repeat(np.array(geoms, dtype=int), [len(points) for points, _ in covers])
        self.radii = np.concatenate([np.zeros(0), *(np.full(len(points), radius) for points, radius in covers)])  # (P,) m

    def centres(self, position: Array, rotation: Array) -> Array:
        """Return the centres of the spheres, (N, P, 3) m.

        Args:
            position: (N, G, 3) m, of all geoms.
            rotation: (N, G, 9), of all geoms.
        """
        frame = rotation.reshape(*rotation.shape[:2], 3, 3)
        centres: Array = position[:, self._owners] + np.einsum("npij,pj->npi", frame[:, self._owners], self._points)
        return centres


class Clearance:
    """How deep an arm is in the table."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._table = model.geom("table").id
        self._half = model.geom_size[self._table].copy()
        self._cover = Cover(model)

    def depth(self, position: Array, rotation: Array) -> Array:
        """Return the depth of the deepest part below the table top, within its rectangle, (N,) m; 0 if none is below.

        Args:
            position: (N, G, 3) m, of all geoms.
            rotation: (N, G, 9), of all geoms.
        """
        table = rotation[:, self._table].reshape(-1, 3, 3)
        centres = self._cover.centres(position, rotation)
        on_table = np.einsum("npi,nij->npj", centres - position[:, self._table, None], table)
        over = (np.abs(on_table[..., :2]) <= self._half[:2]).all(axis=2)
        below: Array = self._half[2] - (on_table[..., 2] - self._cover.radii)
        deepest: Array = np.where(over, below, 0.0).max(axis=1, initial=0.0)
        return deepest


def _is_arm(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a geom belongs to a moving body other than a free object, and can touch anything."""
    body = model.body_rootid[model.geom_bodyid[geom]]
    free = model.body_jntnum[body] > 0 and model.jnt_type[model.body_jntadr[body]] == mujoco.mjtJoint.mjJNT_FREE
    moves = model.body_weldid[model.geom_bodyid[geom]] != 0
    return bool(moves and not free and (model.geom_contype[geom] or model.geom_conaffinity[geom]))


def _cover(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Return points (P, 3) m in the geom's frame, and their radius, m."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        along = np.linspace(-size[1], size[1], 2 + int(2 * size[1] / size[0]))
        return np.stack([0 * along, 0 * along, along], axis=1), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = np.arange(16) * 2 * np.pi / 16
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.concatenate([np.column_stack([rim, np.full(16, end)]) for end in (-size[1], size[1])]), 0.0
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return centre + signs * half, 0.0
