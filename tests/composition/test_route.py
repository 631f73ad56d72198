"""What is left to go along a route, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.composition.route import Route, StraightDistance

ROUTE = Route(np.array([[1.0, 0, 0], [1, 2, 0]]), tolerance=0.1)


def path(*points: tuple[float, float]) -> np.ndarray:
    return np.array([[[[[x, y, 0.0]] for x, y in points]]])


def test_what_is_left_leads_through_every_waypoint_that_is_not_met() -> None:
    points = np.array([[[0.0, 0, 0]], [[1.0, 1, 0]]])
    assert ROUTE.cost_to_go(np.array([0, 1]), points).tolist() == [3, 1]


def test_a_waypoint_is_passed_on_the_way_and_the_last_one_stays_next() -> None:
    progress = ROUTE.follow(np.array([[0]]), path((0, 0), (1, 0.05), (1, 1), (1, 2)), within=0.01)
    assert progress.next_waypoint.tolist() == [[1]] and progress.arrived.tolist() == [3]
    np.testing.assert_allclose(progress.cost, [1.95 + 1.0], err_msg="nothing counts from the arrival on")
    assert ROUTE.follow(np.array([[0]]), path((0, 0), (1, 2))).next_waypoint.tolist() == [[0]], (
        "the last one does not count before its turn"
    )


def test_where_a_path_begins_has_been_looked_at_before() -> None:
    progress = ROUTE.follow(np.array([[0]]), path((1, 0), (0, 0)))
    assert progress.next_waypoint.tolist() == [[0]] and progress.cost.tolist() == [3]


def test_further_keypoints_count_for_nothing_where_the_task_does_not_say_so() -> None:
    keypoints = np.array([[[0.0, 0, 0], [5.0, 5, 5]]])
    assert Route(np.array([[1.0, 0, 0]]), tolerance=0.1).cost_to_go(np.zeros(1, dtype=int), keypoints).tolist() == [1]


class Detour(StraightDistance):
    """Has to fetch something first."""

    def detour(self, keypoints: np.ndarray, waypoint: np.ndarray) -> np.ndarray:
        return np.linalg.norm(keypoints[..., 1, :] - waypoint, axis=-1)


def test_a_detour_counts_by_its_weight_on_the_way_to_the_next_waypoint() -> None:
    route = Route(ROUTE.waypoints, 0.1, Detour(), detour_weight=0.5)
    keypoints = np.array([[[0.0, 0, 0], [1.0, 3, 0]]] * 2)
    assert route.cost_to_go(np.array([0, 1]), keypoints) == pytest.approx([3 + 0.5 * 3, 5**0.5 + 0.5 * 1])
    assert route.remaining_length(np.array([0, 1]), keypoints) == pytest.approx([3, 5**0.5])
