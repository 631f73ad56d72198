"""Triangles of bodies: where a recording draws them, and as large."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from skillcli.evaluation.library import Library
from skillcli.viz import kinematics

pytest.importorskip("viser")

from skillcli.viz.meshes import Detail, meshes
from skillcli.viz.play.solids import solids

FORMS = """<mujoco><worldbody><body name="b">
  <geom type="{form}" size="{size}" pos="0.1 0.2 0.3" euler="90 0 0" rgba="1 0 0 1"/>
  <geom type="sphere" size="0.01" rgba="0 0 1 1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("form", "size", "half"),
    [
        ("box", "0.1 0.2 0.3", [0.1, 0.3, 0.2]),
        ("cylinder", "0.1 0.3", [0.1, 0.3, 0.1]),
        ("capsule", "0.1 0.3", [0.1, 0.4, 0.1]),
        ("ellipsoid", "0.1 0.2 0.3", [0.1, 0.3, 0.2]),
    ],
)
def test_primitives_have_their_size_and_place(form: str, size: str, half: list[float]) -> None:
    model = mujoco.MjModel.from_xml_string(FORMS.format(form=form, size=size))
    red, blue = solids(model)[1]
    np.testing.assert_allclose(red.vertices.min(axis=0), np.array([0.1, 0.2, 0.3]) - half, atol=2e-3)
    np.testing.assert_allclose(red.vertices.max(axis=0), np.array([0.1, 0.2, 0.3]) + half, atol=2e-3)
    assert red.rgba.tolist() == [1, 0, 0, 1] and blue.rgba.tolist() == [0, 0, 1, 1]
    assert red.faces.max() < len(red.vertices)


def test_the_same_bodies_are_drawn_as_in_a_recording(push: Library) -> None:
    model = push.world.model()
    assert model is not None
    found = solids(model)
    assert set(found) == set(kinematics.shapes(model)) | set(meshes(model, Detail.COARSE))
    assert all(part.faces.max() < len(part.vertices) for parts in found.values() for part in parts)
