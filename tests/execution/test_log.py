"""Logs: episodes, control period, speeds, what is refused, and what an artifact's trajectories say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from execution.logs import PERIOD, small_log

from skillcli.errors import UsageError
from skillcli.execution.log import checked, log_of_trajectories
from skillcli.trajectories import Trajectories


def test_episodes_steps_and_period_are_counted() -> None:
    log = small_log((4, 3))
    assert log.episodes == [slice(0, 4), slice(4, 7)] and log.control_steps == 5 and log.period == PERIOD


def test_speed_is_that_of_the_last_two_steps_and_never_looks_ahead() -> None:
    position = np.array([[0.0], [1.0], [3.0], [7.0], [50.0], [50.0]])
    log = small_log((4, 2), position=position, sent=position)
    # 0; 1 / 0.05; 3 / 0.1; 6 / 0.1; the next episode begins at rest
    np.testing.assert_allclose(log.speed[:, 0], [0, 20, 30, 60, 0, 0])
    assert (small_log(velocity=np.ones((7, 2))).speed == 1).all()


def test_a_gap_in_time_begins_an_episode_and_an_episode_of_one_row_is_left_out() -> None:
    stamps = PERIOD * np.array([*range(25), *range(27, 52), 60])
    position = np.arange(51.0)[:, None] / 100
    log = checked(small_log((51,), stamps=stamps, position=position, sent=position, names=("a",)), "log x")
    assert log.starts == (0, 25) and len(log.stamps) == 50
    assert log.notes == ("rows are missing at 2 places: each is the start of a new episode",)


LONG = (30, 30)


def changed(name: str, row: int, value: float) -> dict[str, Any]:
    values = np.array(getattr(small_log(LONG), name))
    values[row] = value
    return {name: values}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (changed("position", 3, np.nan), "log x: position is not a finite number in row 4"),
        (changed("sent", 59, np.inf), "log x: sent is not a finite number in row 60"),
        (changed("stamps", 2, np.nan), "log x: stamps is not a finite number in row 3"),
        (changed("position", 7, 1e6), r"log x: position is 1e\+06 in row 8, at most 100 is believed"),
        (changed("stamps", 40, 0.0), "log x: the stamp of row 41 is not later than the one before"),
        ({"sent": np.zeros((60, 3))}, r"log x: sent has the shape \(60, 3\), expected \(60, 2\)"),
        ({"velocity": np.zeros((59, 2))}, r"log x: velocity has the shape \(59, 2\), expected \(60, 2\)"),
        ({"gripper_position": np.zeros((60, 2))}, r"log x: gripper_position has the shape \(60, 2\), expected \(60, 3\)"),
        ({"stamps": 1000 * small_log(LONG).stamps}, "log x: the control period is 50 s, expected 0.001 to 1 s"),
        ({"stamps": 1e-4 * small_log(LONG).stamps}, "log x: the control period is 0 s"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(changes: dict[str, Any], said: str) -> None:
    checked(small_log(LONG), "log x")
    with pytest.raises(UsageError, match=said):
        checked(small_log(LONG, **changes), "log x")


@pytest.mark.parametrize("lengths", [(5,), (1,) * 30, ()])
def test_a_log_of_less_than_a_second_is_too_short(lengths: tuple[int, ...]) -> None:
    with pytest.raises(UsageError, match=r"expected at least 20"):
        checked(small_log(lengths) if lengths else small_log((0,)), "log x")


def test_trajectories_are_read_up_to_the_length_of_each_episode_and_targets_are_told_or_added_up_from_actions() -> None:
    steps = np.full((2, 30, 1), 0.01, dtype=np.float32)
    angles = np.tile(np.arange(31.0)[None, :, None] / 50, (2, 1, 1)) + np.array([0.0, 1.0])[:, None, None]
    trajectories = Trajectories(
        time=PERIOD * np.arange(31), latent=np.zeros((2, 30, 1)), skill=np.zeros((2, 30)), action=steps,
        reward=np.zeros((2, 30)), target=np.zeros((2, 3)), success=np.ones(2, dtype=bool), length=np.array([30, 2]),
        joint_position=angles, gripper_position=np.zeros((2, 31, 3)),
    )  # fmt: skip
    log = log_of_trajectories(trajectories, ("a",))
    assert log.starts == (0, 31) and len(log.stamps) == 34 and not log.increments
    np.testing.assert_allclose(log.sent[31:, 0], [1.01, 1.02, 1.02], atol=1e-6)
    np.testing.assert_allclose(log.position[31:, 0], [1, 1.02, 1.04])
    assert log_of_trajectories(trajectories, ("a", "b")).names == (), "of another arm, whose names are not known"
    told = log_of_trajectories(trajectories, ("a",), targets=np.full((2, 30, 1), 7.0))
    assert (told.sent == 7).all(), "what was sent is not added up from a measured start"
    with pytest.raises(UsageError, match="holds no joint angles"):
        log_of_trajectories(Trajectories(**{**trajectories.arrays(), "joint_position": None}), ("a",))
