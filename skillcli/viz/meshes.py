"""Triangle meshes of the bodies of a MuJoCo model, whole or as simple as a small file needs them."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import mujoco
import numpy as np

from skillcli.robots.shapes import CORNERS, mesh_vertices
from skillcli.trajectories import Array
from skillcli.viz.kinematics import drawn_geoms, geom_color


class Detail(Enum):
    """How faithfully meshes are drawn, from fine to coarse. Vertices in one cell of a grid are merged."""

    FINE = "triangles on a grid of 1 mm"
    COARSE = "triangles on a grid of 3 mm"
    HULL = "the convex hull, on a grid of 3 mm"
    BOX = "the bounding box"

    @property
    def grid(self) -> float:
        """Return the size of a cell, m."""
        return 1e-3 if self is Detail.FINE else 3e-3


class Mesh(NamedTuple):
    """One mesh geom in the frame of its body."""

    name: str  # of its mesh, with its place among the body's meshes
    vertices: Array  # (V, 3) m, each once
    normals: Array  # (V, 3) outwards, the mean of the faces around a vertex
    faces: Array  # (F, 3) rows of `vertices`
    rgba: Array  # (4,) in 0..1


def meshes(model: mujoco.MjModel, detail: Detail) -> dict[int, list[Mesh]]:
    """Return the meshes to draw of each body that has some."""
    found: dict[int, list[Mesh]] = {}
    for body, geoms in drawn_geoms(model).items():
        kept = [geom for geom in geoms if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH]
        if kept:
            found[body] = [_mesh(model, geom, place, detail) for place, geom in enumerate(kept)]
    return found


def _mesh(model: mujoco.MjModel, geom: int, place: int, detail: Detail) -> Mesh:
    mesh = int(model.geom_dataid[geom])
    rows = model.mesh_faceadr[mesh]
    vertices = np.array(mesh_vertices(model, mesh))
    faces = np.array(model.mesh_face[rows : rows + model.mesh_facenum[mesh]])
    if detail is Detail.BOX:
        center, half = model.geom_aabb[geom].reshape(2, 3)
        vertices = center + half * CORNERS
    if detail in (Detail.HULL, Detail.BOX):
        vertices, faces = _hull(vertices) or (vertices, faces)
    vertices, faces = _merged(vertices, faces, detail.grid)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    vertices = vertices @ turn.reshape(3, 3).T + model.geom_pos[geom]
    name = f"{place}-{model.mesh(mesh).name.rpartition('/')[2]}"
    return Mesh(name, vertices, _normals(vertices, faces), faces, geom_color(model, geom))


def _merged(vertices: Array, faces: Array, grid: float) -> tuple[Array, Array]:
    """Keep one vertex (V, 3) of each cell, and the faces (F, 3) that still have three: files repeat vertices for every face."""
    _, kept, cell = np.unique(np.round(vertices / grid), axis=0, return_index=True, return_inverse=True)
    faces = kept[cell.ravel()[faces]]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    used, rows = np.unique(faces, return_inverse=True)
    return vertices[used], rows.reshape(-1, 3)


def _hull(vertices: Array) -> tuple[Array, Array] | None:
    """Return vertices (V, 3) and faces (F, 3) of the convex hull, faces anticlockwise from outside; None if it is flat."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and rarely needed

    try:
        hull = ConvexHull(vertices)
    except QhullError:
        return None
    corners = vertices[hull.simplices]  # (F, 3, 3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("fi,fi->f", across, hull.equations[:, :3]) < 0
    return vertices, np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)


def _normals(vertices: Array, faces: Array) -> Array:
    """Return the normal at each vertex, (V, 3): the mean of the faces that meet there, weighted by their areas."""
    corners = vertices[faces]  # (F, 3, 3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    np.add.at(total, faces.ravel(), np.repeat(across, 3, axis=0))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    found: Array = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    return found
