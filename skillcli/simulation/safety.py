"""The limits that a real arm and its cell have: joint ranges, joint speeds, a table that is no place for an arm, and a box that
is to be pushed along it.

Judged at the ends of control steps. The tolerances leave room for what the simulation's soft stops and soft contacts do
where a real arm would do nothing wrong.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from skillcli.trajectories import Array

# rad past the end of a joint's range: stops are soft here, and give way by less under a servo that only leans on one.
RANGE_TOLERANCE = 0.005

# m. Contacts are soft here, so a finger that rests on the table sinks in a little. These bound how far geometry may overlap in
# the simulation; they are no bound on the force, which depends on how soft the contact is. MuJoCo's own contact is stiff:
# 0.05 mm is about 30 N on the fingertip. That of the push task rises from nothing: 1 mm is about 45 N, 1.3 mm about
# 120 N. Skills keep off the table where they were trained; where it is higher or tilted they may brush it.
STIFF_TABLE_TOLERANCE = 5e-5
SOFT_TABLE_TOLERANCE = 2e-3

# m that a box may be pressed into the table: the overlap that the contact of the push task is made to stay below. With four
# corners on the table 2.5 mm is about 120 N on the default box, 2.85 mm 600 N: beyond, it is rammed down.
BOX_TOLERANCE = 3e-3

# Cosine of how far a box may tip: past 45 degrees a cube falls over by itself, and where it then lies hangs on little.
UPRIGHT = math.cos(math.radians(45))


class Cover:
    """Balls that stand for an arm.

    Every geom of the arm that collides at all is covered by points, each with a radius: capsules and spheres by balls
    along their axes, boxes by their corners, cylinders by their rims, anything else by the corners of its bounding box.
    Nothing deeper in a plane is missed; between corners and rims there is room for something small.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        geoms = [geom for geom in range(model.ngeom) if _is_arm(model, geom)]
        covers = [_cover(model, geom) for geom in geoms]
        self._points = np.concatenate([np.zeros((0, 3)), *(points for points, _ in covers)])
        self._owners = np.repeat(np.array(geoms, dtype=int), [len(points) for points, _ in covers])
        self.radii = np.concatenate([np.zeros(0), *(np.full(len(points), radius) for points, radius in covers)])  # (P,) m

    def centres(self, position: Array, rotation: Array) -> Array:
        """Where the balls are, (N, P, 3) m.

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
        """How far the deepest part is below the table top, within the table's rectangle, (N,) m; 0 where none is.

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
    """Whether a geom belongs to a moving body that is no free object, and touches anything."""
    body = model.body_rootid[model.geom_bodyid[geom]]
    free = model.body_jntnum[body] > 0 and model.jnt_type[model.body_jntadr[body]] == mujoco.mjtJoint.mjJNT_FREE
    moves = model.body_weldid[model.geom_bodyid[geom]] != 0
    return bool(moves and not free and (model.geom_contype[geom] or model.geom_conaffinity[geom]))


def _cover(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Points (P, 3) m in the geom's frame, and their radius, m."""
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
