"""Orientations, against angles worked out by hand."""

from __future__ import annotations

import numpy as np

from skillcli.simulation.rotations import frames, up, upright


def test_the_frame_of_an_object_turned_by_a_quarter_has_its_x_axis_along_y() -> None:
    frame = frames(upright(np.array([np.pi / 2])))[0]
    np.testing.assert_allclose(frame, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_up_is_the_last_row_of_the_frame() -> None:
    turned = np.random.default_rng(0).standard_normal((5, 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(up(turned), frames(turned)[:, 2], atol=1e-12)
    np.testing.assert_allclose(up(upright(np.array([0.7]))), [[0, 0, 1]], atol=1e-12)
