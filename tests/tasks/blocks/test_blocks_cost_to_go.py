"""What is left to go for a block, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np

from skillcli.composition.route import CostToGo
from skillcli.tasks.blocks.cost_to_go import BlockCostToGo

COST: CostToGo = BlockCostToGo(0.15)
GOAL = np.array([0.3, 0.4, 0.02])


def test_a_block_goes_up_over_and_down() -> None:
    on_table, lifted, over = [0.0, 0, 0.02], [0.0, 0, 0.15], [0.3, 0.4, 0.15]
    keypoints = np.array([[block, block, block] for block in (on_table, lifted, over)])
    np.testing.assert_allclose(COST.distance(keypoints, GOAL), [0.13 + 0.5 + 0.13, 0.5 + 0.13, 0.13])


def test_a_block_at_its_goal_has_to_be_let_go() -> None:
    held = np.array([[[0.3, 0.4, 0.045], [0.3, 0.4, 0.02], [0.3, 0.4, 0.02]]])
    np.testing.assert_allclose(COST.distance(held, GOAL), [0.025])
    assert COST.detour(held, GOAL).tolist() == [0]


def test_the_hand_is_led_to_the_block() -> None:
    away = np.array([[[0.0, 0, 0.02], [0.0, 0.3, 0.42], [0.0, 0, 0.02]]])
    np.testing.assert_allclose(COST.detour(away, GOAL), [0.5])
