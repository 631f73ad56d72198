"""Points on the geoms of a MuJoCo model."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from skillcli.trajectories import Array

CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # of a cube with half edges of one, (8, 3)


def mesh_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    """Return the vertices of a mesh in its own frame, (V, 3) m."""
    first = model.mesh_vertadr[mesh]
    vertices: Array = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return vertices


def outline(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Return the vertices of a mesh, of another shape the corners of the box around it, (P, 3) m in the world."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        local = mesh_vertices(model, model.geom_dataid[geom])
    else:
        centre, half = np.split(model.geom_aabb[geom], 2)  # in the frame of the geom
        local = centre + half * CORNERS
    world: Array = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return world
