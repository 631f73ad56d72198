"""The bodies of a robot as triangles: its meshes, and its primitives, which a browser's viewer does not all have."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import trimesh

from skillcli.trajectories import Array
from skillcli.viz import kinematics
from skillcli.viz.meshes import Detail, meshes


class Solid(NamedTuple):
    """Everything of one colour on one body, in the frame of the body."""

    vertices: Array  # (V, 3) m
    faces: Array  # (F, 3) rows of `vertices`
    rgba: Array  # (4,) in 0..1


def solids(model: mujoco.MjModel) -> dict[int, list[Solid]]:
    """Return what to draw of each body that has something: the same geoms as in a recording."""
    parts: dict[int, list[Solid]] = {}
    for body, shapes in kinematics.shapes(model).items():
        parts.setdefault(body, []).extend(_solid(shape) for shape in shapes)
    for body, surfaces in meshes(model, Detail.COARSE).items():
        parts.setdefault(body, []).extend(Solid(mesh.vertices, mesh.faces, mesh.rgba) for mesh in surfaces)
    return {body: _joined(each) for body, each in sorted(parts.items())}


def _solid(shape: kinematics.Shape) -> Solid:
    radius, half = float(shape.size[0]), float(shape.size[1])
    if shape.form == "box":
        mesh = trimesh.creation.box(extents=2 * shape.size)
    elif shape.form == "ellipsoid":
        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale(shape.size)
    elif shape.form == "cylinder":
        mesh = trimesh.creation.cylinder(radius=radius, height=2 * half, sections=32)
    else:
        mesh = trimesh.creation.capsule(radius=radius, height=2 * half, count=[16, 16])
        mesh.apply_translation([0.0, 0.0, -mesh.bounds.mean(axis=0)[2]])  # MuJoCo's are centred
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.roll(shape.quaternion, 1))
    return Solid(np.asarray(mesh.vertices) @ turn.reshape(3, 3).T + shape.position, np.asarray(mesh.faces), shape.rgba)


def _joined(parts: list[Solid]) -> list[Solid]:
    """Join the parts of each colour: few nodes are quick to draw."""
    colours: dict[tuple[float, ...], list[Solid]] = {}
    for part in parts:
        colours.setdefault(tuple(np.round(part.rgba, 3)), []).append(part)
    return [_merged(same) for same in colours.values()]


def _merged(parts: list[Solid]) -> Solid:
    """Make one of parts of the same colour."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])[:-1]
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return Solid(np.concatenate([part.vertices for part in parts]), np.concatenate(faces), parts[0].rgba)
