"""What is left to go along a route, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np

from skillcli.composition.route import Route

ROUTE = Route(np.array([[1.0, 0, 0], [1, 2, 0]]), tolerance=0.1)


def path(*points: tuple[float, float]) -> np.ndarray:
    return np.array([[[[[x, y, 0.0]] for x, y in points]]])


def test_what_is_left_leads_through_every_waypoint_that_is_due() -> None:
    points = np.array([[[0.0, 0, 0]], [[1.0, 1, 0]]])
    assert ROUTE.left(np.array([0, 1]), points).tolist() == [3, 1]


def test_a_waypoint_is_passed_on_the_way_and_the_last_one_stays_due() -> None:
    walk = ROUTE.follow(np.array([[0]]), path((0, 0), (1, 0.05), (1, 1), (1, 2)), within=0.01)
    assert walk.due.tolist() == [[1]] and walk.arrived.tolist() == [3]
    np.testing.assert_allclose(walk.cost, [1.95 + 1.0], err_msg="nothing counts from the arrival on")
    assert ROUTE.follow(np.array([[0]]), path((0, 0), (1, 2))).due.tolist() == [[0]], (
        "the last one does not count before its turn"
    )


def test_where_a_path_begins_has_been_looked_at_before() -> None:
    walk = ROUTE.follow(np.array([[0]]), path((1, 0), (0, 0)))
    assert walk.due.tolist() == [[0]] and walk.cost.tolist() == [3]


def test_two_landmarks_without_a_box_are_no_box_and_gripper() -> None:
    points = np.array([[[0.0, 0, 0], [5.0, 5, 5]]])
    assert Route(np.array([[1.0, 0, 0]]), tolerance=0.1).left(np.zeros(1, dtype=int), points).tolist() == [1]


def test_beside_a_box_the_gripper_is_led_behind_it() -> None:
    push = Route(np.array([[1.0, 0, 0]]), tolerance=0.1, half_edges=(0.035, 0.035), approach=0.5)
    box = [0.0, 0, 0]
    points = np.array([[box, [-0.05, 0, 0.3]], [box, [0.35, 0, 0.3]]])
    np.testing.assert_allclose(push.left(np.zeros(2, dtype=int), points), [1, 1 + 0.5 * 0.4])
    at_goal = np.array([[[1.0, 0, 0], [5, 5, 0]]])
    assert push.left(np.zeros(1, dtype=int), at_goal).tolist() == [0], "at the goal the gripper may be anywhere"
