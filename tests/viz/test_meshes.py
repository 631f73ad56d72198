"""Triangle meshes: what is kept of them, and where they lie."""

import mujoco
import numpy as np
import pytest
import scenes

from skillcli.trajectories import Array
from skillcli.viz.meshes import Detail, Mesh, meshes

CORNERS = np.array([[0.1, 0, 0], [0.4, 0, 0], [0.1, 0.2, 0], [0.1, 0, 0.1]])  # as the model has them
TURNED = CORNERS[:, [1, 0, 2]] * [-1, 1, 1] + [0.2, 0, 0]  # by a quarter about z, and moved


def model_of(vertices: Array, faces: Array) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.add_mesh(name="m", uservert=vertices.ravel().tolist(), userface=faces.ravel().tolist())
    spec.worldbody.add_body(name="b").add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="m")
    return spec.compile()


def only(model: mujoco.MjModel, detail: Detail) -> Mesh:
    ((mesh,),) = meshes(model, detail).values()
    return mesh


def volume(mesh: Mesh) -> float:
    """Of a closed surface, m³; positive where its faces look outwards."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6)


def a_torus(count: int) -> tuple[Array, Array]:
    """A ring of 0.1 m, 0.06 m thick, each triangle with points of its own."""
    turn, around = np.meshgrid(*2 * [2 * np.pi * np.arange(count) / count], indexing="ij")
    out = 0.1 + 0.03 * np.cos(around)
    a = np.stack([out * np.cos(turn), out * np.sin(turn), 0.03 * np.sin(around)], axis=-1)
    b, c, d = np.roll(a, -1, axis=0), np.roll(a, (-1, -1), axis=(0, 1)), np.roll(a, -1, axis=1)
    vertices = np.concatenate([np.stack(each, axis=2).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


@pytest.mark.parametrize("detail", [Detail.FINE, Detail.COARSE, Detail.HULL])
def test_a_mesh_lies_in_its_body_as_the_model_says(detail: Detail) -> None:
    mesh = only(mujoco.MjModel.from_xml_string(scenes.TETRAHEDRON), detail)
    assert mesh.name == "0-tip"
    assert mesh.rgba == pytest.approx([0.2, 0.4, 0.6, 1.0])
    assert np.unique(mesh.vertices.round(6), axis=0) == pytest.approx(np.unique(TURNED, axis=0), abs=1e-6)
    assert volume(mesh) == pytest.approx(0.3 * 0.2 * 0.1 / 6, rel=1e-5)


def test_normals_point_outwards_and_are_the_mean_of_the_faces_around() -> None:
    mesh = only(mujoco.MjModel.from_xml_string(scenes.TETRAHEDRON), Detail.FINE)
    corner = int(np.linalg.norm(mesh.vertices - TURNED[0], axis=1).argmin())
    # three faces meet at a right angle, the areas of those seen along x, y and z are 3, 2 and 6 / 2 square decimetres
    areas = np.array([0.3 * 0.1, 0.2 * 0.1, 0.3 * 0.2]) / 2
    assert mesh.normals[corner] == pytest.approx(np.array([1, -1, -1]) * areas / np.linalg.norm(areas), abs=1e-6)
    assert np.einsum("vi,vi->v", mesh.normals, mesh.vertices - mesh.vertices.mean(axis=0)).min() > 0


def test_less_detail_is_a_smaller_mesh() -> None:
    model = model_of(*a_torus(60))
    found = [only(model, detail) for detail in Detail]
    counts = [len(mesh.faces) for mesh in found]
    assert counts == sorted(counts, reverse=True) and len(set(counts)) == 4
    assert len(found[0].vertices) == 60 * 60, "each vertex once"
    fine, coarse, hull, box = map(volume, found)
    assert fine == pytest.approx(2 * np.pi**2 * 0.1 * 0.03**2, rel=0.02)
    assert coarse == pytest.approx(fine, rel=0.05), "the hole stays"
    assert 1.5 * fine < hull < 0.9 * box
    assert box == pytest.approx(np.prod(np.ptp(found[0].vertices, axis=0)), rel=1e-3)


def test_a_flat_mesh_has_no_hull_and_stays() -> None:
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="m", uservert=[0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0], userface=[0, 1, 2, 0, 2, 3])
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_body().add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="m", contype=0, conaffinity=0)
    assert len(only(spec.compile(), Detail.HULL).faces) == 2
