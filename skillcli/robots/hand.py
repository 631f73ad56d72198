"""Where the hand of an arm ends, and what it pushes with: a proposal for the keys `gripper` and `finger` of a robot file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from skillcli.robots.mjcf import upwards
from skillcli.robots.shapes import outline
from skillcli.trajectories import Array

# Names that modellers give the place where a tool is mounted, the plainest first.
_WORDS = ("attachment", "flange", "tool", "tcp", "mount", "hand", r"\bee|_ee|eef", "grip")
ACROSS = 1.5  # times as far as along the axis of the last joint, a hand must reach aside to point there
MOUNTS = tuple(re.compile(word, re.IGNORECASE) for word in _WORDS)


@dataclass(frozen=True)
class Hand:
    """What a robot file says of the hand.

    Attributes:
        body: that carries the gripper's frame.
        pos: of the frame in that body, (3,) m.
        quat: w x y z; its z axis points out of the hand.
        finger: bodies that push; None where ours is mounted.
        because: how this was found, in words.
    """

    body: str
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    finger: tuple[str, ...] | None
    because: str


def find_hand(spec: mujoco.MjSpec, model: mujoco.MjModel, joints: tuple[str, ...]) -> Hand:
    """Propose the frame of the gripper, in the model's zero position."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    last = spec.joint(joints[-1]).parent
    below = [last, *last.find_all("body")]
    fixed = [body for body in below if all(part.name == last.name or not part.joints for part in _between(body, last))]
    anchor, axis = data.xanchor[model.joint(joints[-1]).id], data.xaxis[model.joint(joints[-1]).id]
    points = np.concatenate([_points(model, data, body.name) for body in below])
    before = data.xanchor[model.joint(joints[-2]).id]
    out, way = _out_of(points, anchor, before, axis)
    fingers = _fingers(model, [body for body in below if body not in fixed])
    if fingers:
        tips = np.concatenate([_points(model, data, name) for name in fingers])
        reach = (tips - anchor) @ out
        place = tips[reach > reach.max() - 0.01].mean(axis=0)
        place += (reach.max() - (place - anchor) @ out) * out
        return _placed(model, data, last.name, place, out, fingers, f"between the tips of the model's own fingers, {way}")
    for pattern in MOUNTS:
        for element, name, place in _named(spec, data, model, fixed):
            if pattern.search(name):
                along = max(
                    float((place - anchor) @ out), float(((points - anchor) @ out).max()) if element == "body" else -np.inf
                )
                place = place + (along - (place - anchor) @ out) * out
                because = f"at the {element} {name!r}, our finger mounted there, {way}"
                return _placed(model, data, last.name, place, out, None, because)
    end = anchor + ((points - anchor) @ out).max() * out
    return _placed(model, data, last.name, end, out, None, f"where the last link ends, our finger mounted there, {way}")


def _between(body: Any, top: Any) -> list[Any]:
    """A body and those above it, up to `top`."""
    found = []
    for part in upwards(body):
        found.append(part)
        if part.name == top.name:
            break
    return found


def _named(spec: mujoco.MjSpec, data: mujoco.MjData, model: mujoco.MjModel, bodies: list[Any]) -> list[tuple[str, str, Array]]:
    """Sites and bodies of the hand: what it is, its name, and where it is, (3,) m."""
    names = {body.name for body in bodies}
    sites = [site for site in spec.sites if site.name and site.parent.name in names]
    found = [("site", site.name, data.site_xpos[model.site(site.name).id].copy()) for site in sites]
    return found + [("body", body.name, data.xpos[model.body(body.name).id].copy()) for body in bodies[1:]]


def _fingers(model: mujoco.MjModel, moving: list[Any]) -> tuple[str, ...]:
    """Bodies of a gripper that can touch something, the outermost first."""
    ids = [model.body(body.name).id for body in moving]
    return tuple(body.name for body, i in zip(moving, ids, strict=True) if _touches(model, i))


def _touches(model: mujoco.MjModel, body: int) -> bool:
    return bool(((model.geom_bodyid == body) & ((model.geom_contype | model.geom_conaffinity) > 0)).any())


def _points(model: mujoco.MjModel, data: mujoco.MjData, body: str) -> Array:
    """The body's origin, its centre of mass, and the outline of its geoms, (P, 3) m."""
    i = model.body(body).id
    geoms = [outline(model, data, geom) for geom in range(model.ngeom) if model.geom_bodyid[geom] == i]
    return np.concatenate([data.xpos[i][None], data.xipos[i][None], *geoms])


def _out_of(points: Array, anchor: Array, before: Array, axis: Array) -> tuple[Array, str]:
    """Which way leads out of the hand, (3,), and in words how it lies.

    Args:
        points: of the hand, (P, 3) m.
        anchor: of the last joint, (3,) m.
        before: anchor of the joint before it, (3,) m.
        axis: of the last joint, (3,).
    """
    along = (points - before) @ axis
    out = axis if along.max() + along.min() >= 0 else -axis
    aside = (points.max(axis=0) + points.min(axis=0)) / 2 - anchor
    aside -= (aside @ axis) * axis
    sideways = aside / max(float(np.linalg.norm(aside)), 1e-9)
    if ((points - anchor) @ sideways).max() > ACROSS * ((points - before) @ out).max():
        return sideways, "pointing where the hand lies from the last joint, across its axis"
    return out, "pointing along the axis of the last joint"


def _placed(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: str,
    place: Array,
    out: Array,
    finger: tuple[str, ...] | None,
    because: str,
) -> Hand:
    i = model.body(body).id
    turned = data.xmat[i].reshape(3, 3)
    local, z = turned.T @ (place - data.xpos[i]), turned.T @ out
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, z)
    return Hand(body, _rounded(local), _rounded(quat), finger, because)


def _rounded(numbers: Array) -> tuple[float, ...]:
    return tuple(round(float(x), 5) + 0.0 for x in numbers)
