"""Fits: numbers stand for parameters, noise is weighed by hand, and known robots are recovered."""

from __future__ import annotations

import numpy as np
import pytest
from execution.logs import LIMIT, PERIOD, SAWYER, recorded, wandering

from skillcli.execution.identify.fit import FIRST_NOISE, LEAST_NOISE, Fit, effective_noise, fit
from skillcli.execution.identify.knobs import Knobs
from skillcli.execution.identify.model import Meaning, Model
from skillcli.execution.identify.noise import white_noise
from skillcli.execution.identify.windows import stretches
from skillcli.simulation.replay import Replay


def test_zero_is_the_nominal_robot_and_one_a_standard_deviation_of_what_is_believed() -> None:
    knobs = Knobs(["gain", "gravity_compensation"], 2)
    assert knobs.count == 3
    nominal = knobs.parameters(np.zeros(3))
    assert nominal["gain"].tolist() == [1, 1] and nominal["gravity_compensation"] == 1
    moved = knobs.parameters(np.array([1.0, -1.0, 2.0]))
    assert moved["gain"] == pytest.approx([np.exp(0.35), np.exp(-0.35)]) and moved["gravity_compensation"] == pytest.approx(1.2)
    value, low, high = knobs.interval("gravity_compensation", np.zeros(3), np.full(3, 0.5))
    assert (value, low, high) == (1, pytest.approx(1 - 1.96 * 0.05), pytest.approx(1 + 1.96 * 0.05))
    assert knobs.parameters(np.full(3, 50.0))["gravity_compensation"] == 3, "within the bounds of a domain"


def test_errors_that_follow_each_other_count_for_less() -> None:
    alternating = np.tile([1.0, -1.0], 50)[None, :, None]
    assert effective_noise(alternating) == pytest.approx([1.0]), "they differ from their neighbours: no less than independent"
    constant = np.concatenate([np.ones((1, 50, 1)), -np.ones((1, 50, 1))])
    # within a window neighbours are the same: r = 1, cut off at 0.95, so sqrt(1.95 / 0.05)
    assert effective_noise(constant) == pytest.approx([np.sqrt(39)])
    assert effective_noise(np.zeros((1, 5, 1))).tolist() == [LEAST_NOISE]


def test_white_noise_is_what_neighbours_do_not_share() -> None:
    rng = np.random.default_rng(0)
    slow = np.repeat(rng.standard_normal((40, 1, 7)), 100, axis=1)
    value, low, high = white_noise(0.01 * slow + 0.004 * rng.standard_normal((40, 100, 7)))
    assert low < 0.004 < high and value == pytest.approx(0.004, rel=0.05)
    assert white_noise(0.01 * slow)[0] == pytest.approx(0, abs=1e-9)


def test_a_knob_must_explain_more_than_it_is_free_to() -> None:
    def evidence(cost: float, variances: list[float]) -> float:
        count = len(variances)
        knobs, none = Knobs(["gravity_compensation"], 7), np.zeros((1, 1, 1))
        found = Fit(knobs, np.zeros(count), np.diag(variances), 0.0, np.ones(1), np.ones(1), none, np.zeros((1, count)), cost)
        return found.log_evidence

    assert evidence(4.0, [0.25, 1.0]) == pytest.approx(-(4 + np.log(4)) / 2)
    # a second knob, known to a hundredth of what was believed, costs 2 ln 100 = 9.2
    assert evidence(10.0, [0.25]) > evidence(1.0, [0.25, 1e-4]) and evidence(10.5, [0.25]) < evidence(1.0, [0.25, 1e-4])


def test_gains_are_recovered_and_a_joint_that_never_moves_keeps_what_was_believed() -> None:
    true = np.array([0.75, 1.3, 0.8, 1.2, 0.85, 1.25, 1.3])
    log = recorded({"gain": true, "latency": 0.05}, wandering(100, still=(6,)), noise=0.002)
    model = Model(log, Replay(SAWYER, PERIOD, LIMIT, threads=1))
    knobs = Knobs(["gain", "joint_damping"], 7)
    windows = stretches(log, np.ones(101, dtype=bool))
    found = fit(model, Meaning.TARGETS, windows, knobs, 0.05, noise=np.full(7, 0.002), evaluations=5)
    value, low, high = knobs.interval("gain", found.x, np.sqrt(np.diag(found.covariance)))
    np.testing.assert_allclose(value[:6], true[:6], rtol=0.12)
    assert ((low < true) & (true < high))[:6].sum() >= 5
    assert value[6] == pytest.approx(1, abs=0.15) and low[6] < 0.55 and high[6] > 1.7
    damping = knobs.interval("joint_damping", found.x, np.sqrt(np.diag(found.covariance)))
    assert (damping[1] < 0.4).all() and (damping[2] > 2.5).all(), "beside that of its servo a joint's own is too small to tell"
    assert found.noise[:6] == pytest.approx(np.full(6, 0.002), rel=0.3) and FIRST_NOISE > 0.002
