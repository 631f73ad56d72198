"""Latency and meaning of commands: every possibility is tried."""

from __future__ import annotations

import numpy as np
import pytest
from execution.logs import LIMIT, PERIOD, SAWYER, recorded, wandering

from skillcli.execution.identify.fit import fit
from skillcli.execution.identify.knobs import Knobs
from skillcli.execution.identify.model import Meaning, Model
from skillcli.execution.identify.structure import compare, readings, refine, whole_steps
from skillcli.execution.identify.windows import short_windows, stretches
from skillcli.simulation.replay import Replay

pytestmark = pytest.mark.slow  # fits


def test_latencies_are_whole_control_steps_as_far_as_actuators_remember() -> None:
    assert whole_steps(0.05) == pytest.approx([0, 0.05, 0.1, 0.15])
    assert whole_steps(0.1) == pytest.approx([0, 0.1]) and whole_steps(0.2) == [0]


@pytest.fixture(scope="module")
def replay() -> Replay:
    return Replay(SAWYER, PERIOD, LIMIT, threads=1)


@pytest.mark.parametrize("latency", [0.0, 0.1])
def test_the_latency_of_a_log_is_found_through_noise(replay: Replay, latency: float) -> None:
    log = recorded({"latency": latency, "gain": np.full(7, 0.8)}, wandering(40), noise=0.005)
    windows = short_windows(log, 10, np.ones(41, dtype=bool))
    tried = compare({"rad": Model(log, replay)}, windows, [Meaning.TARGETS], Knobs(["gain"], 7))
    assert len(tried) == 4 and tried[0].latency == pytest.approx(latency)


def test_what_increments_mean_is_found(replay: Replay) -> None:
    for restart, meaning in ((0.0, Meaning.ADDED), (1.0, Meaning.RESTARTED)):
        log = recorded({"command_restart": restart, "latency": 0.05}, wandering(40), noise=0.002, as_targets=False)
        windows = short_windows(log, 10, np.ones(41, dtype=bool))
        best = compare(readings(log, replay), windows, [Meaning.ADDED, Meaning.RESTARTED], Knobs(["command_response"], 7))[0]
        assert (best.meaning, best.latency) == (meaning, pytest.approx(0.05))


@pytest.mark.parametrize(("latency", "noise", "low", "high"), [(0.03, 0.0, 0.03, 0.03), (0.05, 0.005, 0.04, 0.06)])
def test_a_latency_between_control_steps_needs_a_log_that_shows_it(
    replay: Replay, latency: float, noise: float, low: float, high: float
) -> None:
    log = recorded({"latency": latency}, wandering(60), noise=noise)
    model, windows = Model(log, replay), stretches(log, np.ones(61, dtype=bool))
    found = fit(model, Meaning.TARGETS, windows, Knobs(["gain"], 7), 0.05, evaluations=4)
    late = refine(model, Meaning.TARGETS, windows, found)
    assert late.value == pytest.approx(latency) and low <= late.low <= late.value <= late.high <= high
