"""Find joint angles that bring the gripper to a place, by bounded least squares (scipy) on MuJoCo's kinematics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import least_squares

from skillcli.robots.posture import overlaps
from skillcli.robots.robot import Robot
from skillcli.robots.scene import GRIPPER, LIMIT_MARGIN
from skillcli.trajectories import Array

REACHED = 1e-3  # m: the gripper is at the place if it is nearer than this
DOWN_WEIGHT = 5e-3  # m: cost of a gripper that points sideways; small, so that the place always weighs more
NEAR_WEIGHT = 5e-4  # m/rad: cost of the distance from the posture to stay near
MOST_STEPS = 40  # of one search, at most
SEARCHES = 8  # from random postures, after the one from the given posture


class Posture(NamedTuple):
    """Joint angles with the gripper at a place.

    Attributes:
        angles: (n,) rad.
        down: cosine of the angle between the gripper's axis and straight down.
    """

    angles: Array
    down: float


class Kinematics:
    """Forward and inverse kinematics of one arm, with collisions.

    Args:
        robot: the arm, behind its table.
        margin: how far all angles stay inside their ranges, rad.
    """

    def __init__(self, robot: Robot, margin: float = 0.1) -> None:
        self.robot, self.model = robot, robot.model
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in robot.names.joints]
        self._joints = np.array([joint.id for joint in joints])
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._dofs = np.array([joint.dofadr[0] for joint in joints])
        self._site = self.model.site(GRIPPER).id
        self.low, self.high = self._ranges(margin)

    def gripper(self, angles: Array) -> tuple[Array, Array]:
        """Compute the gripper's position, (3,) m, and pointing direction, (3,), at angles (n,) rad."""
        self.data.qpos[self._qpos] = angles
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.site_xpos[self._site].copy(), self.data.site_xmat[self._site].reshape(3, 3)[:, 2].copy()

    def height(self, angles: Array) -> float:
        """Compute the mean height of the joints, m, at angles (n,) rad."""
        self.gripper(angles)
        return float(self.data.xanchor[self._joints, 2].mean())

    def solve(self, place: Array, near: Array, down: bool = False) -> Posture | None:
        """Search once, from `near`, for a posture with the gripper at a place; None if there is none. See `postures`."""
        return self._search(place, np.clip(near, self.low, self.high), near, down)

    def postures(self, place: Array, near: Array, down: bool = False) -> Iterator[Posture]:
        """Yield postures without collision with the gripper at a place (3,) m, the one searched from `near` first.

        Args:
            place: in the frame of the base.
            near: angles (n,) rad that the first search begins with, and all stay near.
            down: whether the gripper should point down as far as the arm can.
        """
        rng = np.random.default_rng(0)
        for search in range(1 + SEARCHES):
            first = near if search == 0 else rng.uniform(self.low, self.high)
            found = self._search(place, np.clip(first, self.low, self.high), near, down)
            if found is not None:
                yield found

    def collides(self, angles: Array) -> bool:
        """Check whether any parts overlap at angles (n,) rad."""
        self.data.qpos[self._qpos] = angles
        return bool(overlaps(self.model, self.data))

    def passes(self, start: Array, end: Array, samples: int = 8) -> bool:
        """Check whether a straight line between joint angles (n,) rad is free of collisions."""
        return not any(self.collides(start + share * (end - start)) for share in np.linspace(0, 1, samples + 1))

    def _search(self, place: Array, first: Array, near: Array, down: bool) -> Posture | None:
        weight = DOWN_WEIGHT if down else 0.0
        straight_down = np.array([0.0, 0.0, -1.0])

        def residual(angles: Array) -> Array:
            at, axis = self.gripper(angles)
            return np.concatenate([at - place, weight * (axis - straight_down), NEAR_WEIGHT * (angles - near)])

        def jacobian(angles: Array) -> Array:
            _, axis = self.gripper(angles)
            mujoco.mj_comPos(self.model, self.data)
            moves, turns = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
            mujoco.mj_jacSite(self.model, self.data, moves, turns, self._site)
            moves, turns = moves[:, self._dofs], turns[:, self._dofs]
            return np.concatenate([moves, weight * np.cross(turns.T, axis).T, NEAR_WEIGHT * np.eye(len(angles))])

        inside = np.clip(first, self.low + 1e-6, self.high - 1e-6)  # scipy starts strictly inside
        angles: Array = least_squares(residual, inside, jacobian, bounds=(self.low, self.high), max_nfev=MOST_STEPS).x
        at, axis = self.gripper(angles)
        if np.linalg.norm(at - place) > REACHED or self.collides(angles):
            return None
        return Posture(angles, float(-axis[2]))

    def _ranges(self, margin: float) -> tuple[Array, Array]:
        """Return the lowest and highest angle that joint and servo allow, (n,) rad each; one turn without limits."""
        low, high = np.full(len(self._qpos), -np.pi), np.full(len(self._qpos), np.pi)
        for index, (name, servo) in enumerate(zip(self.robot.names.joints, self.robot.names.servos, strict=True)):
            joint = self.model.joint(name)
            address = self.model.actuator_ctrladr[self.model.actuator(servo).id]
            limits = [tuple(joint.range)] if self.model.jnt_limited[joint.id] else []
            limits += [tuple(self.model.actuator_ctrlrange[address])] if self.model.actuator_ctrllimited[address] else []
            if limits:
                low[index], high[index] = max(pair[0] for pair in limits), min(pair[1] for pair in limits)
        inside = np.minimum(margin + LIMIT_MARGIN, (high - low) / 4)
        return low + inside, high - inside
