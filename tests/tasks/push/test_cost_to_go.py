"""What is left to go for a box, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np

from skillcli.composition.route import CostToGo, Route
from skillcli.tasks.push.cost_to_go import BoxCostToGo
from skillcli.tasks.push.geometry import CONTACT_GAP
from skillcli.tasks.push.settings import TURN

COST: CostToGo = BoxCostToGo((0.035, 0.035))
BOX, GOAL = [0.0, 0, 0], np.array([1.0, 0, 0])


def test_the_gripper_is_led_behind_the_box() -> None:
    keypoints = np.array([[BOX, [-0.035 - CONTACT_GAP, 0, 0.3]], [BOX, [0.35, 0, 0.3]]])
    np.testing.assert_allclose(COST.distance(keypoints, GOAL), [1, 1])
    np.testing.assert_allclose(COST.detour(keypoints, GOAL), [0, 0.4], atol=1e-12)
    route = Route(GOAL[None], 0.1, COST, detour_weight=0.5)
    np.testing.assert_allclose(route.cost_to_go(np.zeros(2, dtype=int), keypoints), [1, 1 + 0.5 * 0.4])


def test_a_turn_still_to_come_is_some_of_the_way_and_leads_the_gripper_beside_the_middle() -> None:
    goal = np.array([0.4, 0.0, 0.3 * TURN])
    keypoints = np.array([[BOX, [-0.035 - CONTACT_GAP, -0.7 * 0.035, 0.3]]])
    np.testing.assert_allclose(COST.distance(keypoints, goal), [np.hypot(0.4, 0.3 * TURN)])
    np.testing.assert_allclose(COST.detour(keypoints, goal), [0], atol=1e-12)


def test_with_the_box_at_its_goal_the_gripper_may_be_anywhere() -> None:
    at_goal = np.array([[GOAL, [5, 5, 0]]])
    assert COST.distance(at_goal, GOAL).tolist() == COST.detour(at_goal, GOAL).tolist() == [0]
