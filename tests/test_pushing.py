"""Where a finger pushes a box from, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.pushing import CONTACT_GAP, place_behind, share

SQUARE, PLANK = np.array([0.03, 0.03]), np.array([0.15, 0.02])

# half edges, goal as seen from the box, how far behind the box the finger belongs
BEHIND = [
    (SQUARE, (1.0, 0.0), 0.045),
    (SQUARE, (0.0, -0.1), 0.045),
    (SQUARE, (0.3, 0.4), 0.03 * 0.6 + 0.03 * 0.8 + 0.015),
    (PLANK, (0.2, 0.0), 0.165),
    (PLANK, (0.0, 0.2), 0.035),
    (PLANK, (-0.3, 0.4), 0.15 * 0.6 + 0.02 * 0.8 + 0.015),
]


@pytest.mark.parametrize(("half_edges", "goal", "distance"), BEHIND)
def test_the_finger_stands_on_the_far_side_outside_the_face_it_pushes(
    half_edges: np.ndarray, goal: tuple[float, float], distance: float
) -> None:
    box = np.array([0.6, -0.2])
    place = place_behind(box, box + np.array(goal), half_edges)
    np.testing.assert_allclose(place - box, -distance * np.array(goal) / np.hypot(*goal), atol=1e-12)


def test_its_ball_never_overlaps_the_box_wherever_the_goal_is() -> None:
    angle = np.linspace(0, 2 * np.pi, 181)
    goal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for half_edges in (SQUARE, PLANK):
        outside = np.abs(place_behind(np.zeros((181, 2)), goal, half_edges)) - half_edges
        gap = np.linalg.norm(np.maximum(outside, 0), axis=1)
        assert gap.min() >= CONTACT_GAP - 1e-12 and gap.min() == pytest.approx(CONTACT_GAP)


def test_at_the_goal_there_is_no_way_behind_and_it_counts_for_nothing() -> None:
    np.testing.assert_array_equal(place_behind(np.ones(2), np.ones(2), SQUARE), np.ones(2))
    assert share(np.array([0.0, 0.015, 0.03, 1.0])).tolist() == [0, 0.5, 1, 1]
