"""Where the base of a model has to stand: on our table, looking along x."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.mjcf import upwards
from skillcli.robots.shapes import outline
from skillcli.trajectories import Array

HIGHEST, SHOULDER = 0.6, 0.4  # lengths of the arm: shoulders farther above the ground are on a trunk; and above its table
STANDS = 0.02  # m from the table within which a base stands on it
POSTURES = 2000  # at random
ONE_SIDED = 0.1  # mean of the directions to where the hand can be, from which on an arm looks to one side


def stand_on_table(spec: mujoco.MjSpec, model: mujoco.MjModel, joints: tuple[str, ...]) -> tuple[float, float, float] | None:
    """How far the model has to be moved so that it stands on the table at the origin, m; None where it does.

    The table of an arm on a trunk, whose shoulder is too high above the ground, is as high as suits the arm.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchors = data.xanchor[[model.joint(name).id for name in joints]]
    x, y, z = (float(part) for part in anchors[0])
    length = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
    low = _lowest(model, data, [body.name for body in upwards(spec.joint(joints[0]).parent)][1:-1])
    low = z if low is None else low
    if z - low > HIGHEST * length:
        low = z - SHOULDER * length
    away = (-x if abs(x) > 0.15 else 0.0, -y if abs(y) > 0.15 else 0.0, -low if abs(low) > STANDS else 0.0)
    moved = tuple(round(part, 4) + 0.0 for part in away)
    return (moved[0], moved[1], moved[2]) if any(moved) else None


def _lowest(model: mujoco.MjModel, data: mujoco.MjData, bodies: list[str]) -> float | None:
    """Where bodies end below, m: what is only for the eye says it better than shapes that touch; None without any shape."""
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    geoms = [i for i in range(model.ngeom) if model.body(model.geom_bodyid[i]).name in bodies and model.geom_type[i] != plane]
    seen = [i for i in geoms if not (model.geom_contype[i] or model.geom_conaffinity[i])]
    return min((float(outline(model, data, i)[:, 2].min()) for i in seen or geoms), default=None)


def turned_forward(kinematics: Kinematics) -> tuple[float, float, float, float] | None:
    """The quarter turn of the base after which most of what the hand can reach is along x; None where none is needed."""
    away = places_of_hand(kinematics)[:, :2] - np.array(kinematics.robot.workspace.shoulder[:2])
    x, y = (away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)).mean(axis=0)
    quarters = round(float(np.arctan2(-y, x)) / (np.pi / 2))
    if np.hypot(x, y) < ONE_SIDED or quarters == 0:
        return None
    half = quarters * np.pi / 4
    return (round(float(np.cos(half)), 5) + 0.0, 0.0, 0.0, round(float(np.sin(half)), 5))


def places_of_hand(kinematics: Kinematics) -> Array:
    """Where the gripper is in random postures, (P, 3) m."""
    rng = np.random.default_rng(0)
    return np.array([kinematics.gripper(rng.uniform(kinematics.low, kinematics.high))[0] for _ in range(POSTURES)])


def rotated(place: Sequence[float], quat: Sequence[float]) -> tuple[float, float, float]:
    """A place (3,) m turned by a unit quaternion w x y z."""
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, np.array(place, dtype=float), np.array(quat))
    x, y, z = (round(float(part), 4) + 0.0 for part in turned)
    return x, y, z
