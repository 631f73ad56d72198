"""What the commands of a log come to, by hand, and what is predicted from them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from execution.logs import LIMIT, NAMES, PERIOD, SAWYER, recorded, small_log, wandering

from skillcli.execution.identify.model import Meaning, Model
from skillcli.execution.identify.windows import short_windows
from skillcli.simulation.replay import Replay
from skillcli.trajectories import Array


def model_of(log: Any, limit: float = 0.04) -> Model:
    replay: Any = SimpleNamespace(action_limit=limit, physics_step=0.005)
    return Model(log, replay)


RESPONSES = np.array([[1.0, 1.0], [0.5, 2.0]])


def test_increments_that_add_up_are_clipped_and_lead_the_joint_by_a_fifth_of_a_radian_at_most() -> None:
    sent = np.array([[0.03, 1.0], [-0.5, 1.0], [0.01, 1.0]])
    log = small_log((3,), position=np.array([[0.0, 1.0], [0.1, 1.0], [0.4, 1.0]]), sent=sent, increments=True)
    commanded = model_of(log, 0.15).commanded(Meaning.ADDED, RESPONSES)
    # joint a: 0.03, then -0.15 more; 0.4 then takes its command along to 0.2. joint b stays at 1: 1.15, 1.2, 1.2
    np.testing.assert_allclose(commanded[0], [[0.03, 1.15], [-0.1, 1.2], [0.2, 1.2]])
    # half of each increment, and twice: 0.015, -0.06, 0.2
    np.testing.assert_allclose(commanded[1], [[0.015, 1.2], [-0.06, 1.2], [0.2, 1.2]])


def test_each_episode_begins_where_its_arm_stands() -> None:
    log = small_log((2, 2), sent=np.full((4, 2), 0.01), increments=True)
    commanded = model_of(log).commanded(Meaning.ADDED, RESPONSES[:1])[0]
    np.testing.assert_allclose(commanded[:, 0], [0.01, 0.02, 0.03, 0.04], err_msg="position 0 and position 0.02")


def test_increments_that_restart_begin_at_the_measured_angle() -> None:
    log = small_log((3,), sent=np.full((3, 2), 0.1), increments=True)
    np.testing.assert_allclose(model_of(log).commanded(Meaning.RESTARTED, RESPONSES)[1][:, 0], [0.02, 0.03, 0.04])
    np.testing.assert_allclose(model_of(log).commanded(Meaning.TARGETS, RESPONSES)[0], log.sent)


@pytest.fixture(scope="module")
def replay() -> Replay:
    return Replay(SAWYER, PERIOD, LIMIT, threads=1)


def errors(log: Any, replay: Replay, meaning: Meaning, length: int = 10, **parameters: Any) -> Array:
    model, windows = Model(log, replay), short_windows(log, length, np.ones(len(log.stamps), dtype=bool))
    given = {name: np.asarray(value, dtype=float) for name, value in parameters.items()}
    off: Array = np.abs(model.predict(windows, meaning, [given])[0] - model.measured(windows)).max(axis=(1, 2))
    return off


@pytest.mark.parametrize("as_targets", [True, False])
def test_the_first_window_of_a_simulated_log_is_predicted_exactly(replay: Replay, as_targets: bool) -> None:
    true = {"latency": 0.05, "gain": np.linspace(0.7, 1.3, 7)}
    log = recorded(true, wandering(30), as_targets=as_targets)
    meaning = Meaning.TARGETS if as_targets else Meaning.ADDED
    off = errors(log, replay, meaning, **true)
    assert off[0] < 1e-6, "it begins at rest, as the log does"
    assert off.max() < 0.01, "others begin with a speed that is taken from two angles"
    assert errors(log, replay, meaning)[0] > 0.02


def test_a_command_that_restarts_is_predicted_exactly_too(replay: Replay) -> None:
    true = {"command_restart": 1.0, "latency": 0.05, "command_response": np.linspace(0.4, 1.2, len(NAMES))}
    log = recorded(true, wandering(20), as_targets=False)
    response = {name: true[name] for name in ("latency", "command_response")}
    assert errors(log, replay, Meaning.RESTARTED, **response)[0] < 1e-6 < errors(log, replay, Meaning.ADDED, **response)[0]


def test_parameters_side_by_side_predict_what_each_predicts_alone(replay: Replay) -> None:
    log = recorded({}, wandering(40), as_targets=False)
    model, windows = Model(log, replay), short_windows(log, 10, np.ones(41, dtype=bool))
    points = [{"command_response": np.full(7, share), "gain": np.full(7, 1 / share)} for share in np.linspace(0.5, 1.5, 80)]
    together = model.predict(windows, Meaning.ADDED, points)  # 320 simulations: more than one batch
    for index in (0, 63, 79):
        np.testing.assert_array_equal(model.predict(windows, Meaning.ADDED, [points[index]])[0], together[index])
