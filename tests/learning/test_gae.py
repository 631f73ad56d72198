"""Advantages worked out by hand: gamma 1/2, lambda 1/2, so that gamma * lambda = 1/4."""

import numpy as np
import pytest

from skillcli.learning.gae import advantages
from skillcli.trajectories import Array

REWARD, VALUE, LAST = [1.0, 2.0], [3.0, 4.0], 8.0


def column(values: list[float]) -> Array:
    return np.array(values)[:, None]


def hand(terminated: list[bool], valid: list[bool]) -> list[float]:
    found = advantages(
        column(REWARD), column(VALUE), np.array([LAST]), np.array(terminated)[:, None], np.array(valid)[:, None], 0.5, 0.5
    )
    return [float(a) for a in found[:, 0]]


def test_the_value_behind_a_time_out_is_bootstrapped() -> None:
    # delta_1 = 2 + 8/2 - 4 = 2;  delta_0 = 1 + 4/2 - 3 = 0;  A_0 = 0 + 2/4
    assert hand([False, False], [True, True]) == pytest.approx([0.5, 2.0])


def test_nothing_is_expected_behind_a_failure() -> None:
    # delta_1 = 2 - 4 = -2;  A_0 = 0 - 2/4
    assert hand([False, True], [True, True]) == pytest.approx([-0.5, -2.0])


def test_steps_behind_the_end_count_for_nothing() -> None:
    # failed at once: delta_0 = 1 - 3 = -2, whatever stands behind
    assert hand([True, False], [True, False]) == pytest.approx([-2.0, 0.0])


def test_without_lambda_it_is_one_step_and_with_all_of_it_the_whole_return() -> None:
    rng = np.random.default_rng(0)
    reward, value, last = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.normal(size=3)
    never, always = np.zeros((5, 3), dtype=bool), np.ones((5, 3), dtype=bool)
    following = np.concatenate([value[1:], last[None]])
    one_step = advantages(reward, value, last, never, always, 0.9, 0.0)
    np.testing.assert_allclose(one_step, reward + 0.9 * following - value)
    powers = 0.9 ** np.arange(6)
    whole = np.stack([(powers[: 5 - t, None] * reward[t:]).sum(0) + powers[5 - t] * last for t in range(5)])
    np.testing.assert_allclose(advantages(reward, value, last, never, always, 0.9, 1.0), whole - value)
