"""Where a finger pushes a box from, by numbers worked out by hand."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from skillcli.tasks.push.geometry import CONTACT_GAP, climb, place_behind, share

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


def test_a_box_that_has_to_turn_is_pushed_beside_its_middle() -> None:
    ahead, turns = np.array([0.2, 0.0]), np.array([0.15, 0.3, 1.0, -0.3])
    place = place_behind(np.zeros((4, 2)), np.tile(ahead, (4, 1)), SQUARE, turns)
    np.testing.assert_allclose(place, [[-0.045, y] for y in (-0.0105, -0.021, -0.021, 0.021)], atol=1e-12)
    for angle in (1.0, 2.5):
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        beside = place_behind(np.zeros(2), turned @ ahead, SQUARE, 0.3) - place_behind(np.zeros(2), turned @ ahead, SQUARE)
        np.testing.assert_allclose(beside, turned @ [0.0, -0.021], atol=1e-12)


def test_its_ball_never_overlaps_the_box_wherever_the_goal_is() -> None:
    angle = np.linspace(0, 2 * np.pi, 181)
    goal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for half_edges, turn in product((SQUARE, PLANK), (0.0, 0.1, -3.0)):
        outside = np.abs(place_behind(np.zeros((181, 2)), goal, half_edges, turn)) - half_edges
        gap = np.linalg.norm(np.maximum(outside, 0), axis=1)
        assert gap.min() >= CONTACT_GAP - 1e-12 and gap.min() == pytest.approx(CONTACT_GAP)


def test_at_the_goal_there_is_no_way_behind_and_it_counts_for_nothing() -> None:
    np.testing.assert_array_equal(place_behind(np.ones(2), np.ones(2), SQUARE), np.ones(2))
    assert share(np.array([0.0, 0.015, 0.03, 1.0])).tolist() == [0, 0.5, 1, 1]


CUBE, SLAB = np.array([0.03, 0.03, 0.03]), np.array([0.15, 0.02, 0.04])

# half edges, finger as seen from the middle of the box's foot, how much higher it has to be; the goal is far along +x
IN_THE_WAY = [
    (CUBE, (0.05, 0.0, 0.14), 0.0),  # high enough already
    (CUBE, (0.05, 0.0, 0.05), 0.045),  # the top, the ball's radius and 2 cm to spare: 9.5 cm
    (CUBE, (0.2, 0.0, 0.015), 0.08),  # however far before it
    (CUBE, (0.0, 0.0, 0.075), 0.02),  # touching its top
    (CUBE, (-0.0225, 0.0, 0.055), 0.02),  # half past its rear
    (CUBE, (-0.045, 0.0, 0.03), 0.0),  # where it pushes
    (CUBE, (-0.04, 0.0, 0.03), 0.0),  # pressed 5 mm into the box
    (CUBE, (0.0, 0.045, 0.03), 0.065),  # touching its flank
    (CUBE, (0.0, -0.0525, 0.035), 0.03),
    (CUBE, (0.0, 0.06, 0.03), 0.0),  # free to go round
    (SLAB, (0.0, 0.0, 0.03), 0.085),
    (SLAB, (0.0, 0.05, 0.03), 0.0),
    (SLAB, (-0.165, 0.0, 0.03), 0.0),
]


@pytest.mark.parametrize(("half_edges", "finger", "higher"), IN_THE_WAY)
def test_a_finger_climbs_over_the_box_that_is_in_its_way(
    half_edges: np.ndarray, finger: tuple[float, float, float], higher: float
) -> None:
    box = np.array([0.6, -0.2, half_edges[2]])
    place = np.array([0.6, -0.2, 0.0]) + finger
    goal = box[:2] + np.array([0.5, 0.0])
    assert climb(place, box, goal, half_edges) == pytest.approx(higher, abs=1e-12)


def test_what_is_in_the_way_does_not_depend_on_where_the_goal_lies_from_a_square_box() -> None:
    box, finger = np.array([0.0, 0.0, 0.03]), np.array([0.04, 0.02, 0.01])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    expected = climb(finger, box, np.array([0.3, 0.1]), CUBE)
    turned = climb(np.array([*(turn @ finger[:2]), 0.01]), box, turn @ [0.3, 0.1], CUBE)
    mirrored = climb(finger * [1, -1, 1], box, np.array([0.3, -0.1]), CUBE)
    assert expected > 0.02 and turned == pytest.approx(expected) and mirrored == pytest.approx(expected)


def test_a_box_at_its_goal_is_in_nobodys_way() -> None:
    box = np.array([0.6, 0.0, 0.03])
    assert climb(box + np.array([0.0, 0.0, 0.03]), box, box[:2], CUBE) * share(np.zeros(1)) == 0
