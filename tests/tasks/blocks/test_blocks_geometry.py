"""Directions of blocks, against angles worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.tasks.blocks.geometry import face_heading, heading, quarter_turn


def test_headings_are_angles_from_x_as_seen_from_above() -> None:
    np.testing.assert_allclose(heading(np.array([[1, 1, 0.5], [0, -2, 0]])), [np.pi / 4, -np.pi / 2])


@pytest.mark.parametrize(
    ("angle", "smallest"), [(0.1, 0.1), (np.pi / 2 + 0.1, 0.1), (-np.pi + 0.2, 0.2), (1.0, 1.0 - np.pi / 2)]
)
def test_a_cube_looks_the_same_after_quarter_turns(angle: float, smallest: float) -> None:
    assert quarter_turn(np.array([angle]))[0] == pytest.approx(smallest)


def test_a_toppled_block_has_the_heading_of_a_level_side() -> None:
    toppled = np.array([[np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0]])  # about y: its x axis points down
    assert quarter_turn(face_heading(toppled))[0] == pytest.approx(0.0, abs=1e-12)
