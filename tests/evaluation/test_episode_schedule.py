"""What is fed to the episodes of a transfer."""

from __future__ import annotations

import numpy as np

from skillcli.evaluation.episode_schedule import EpisodeSchedule

# Two episodes of three steps, the second only two long, in a latent space of one dimension.
LATENT = np.array([[[1.0], [2.0], [3.0]], [[4.0], [5.0], [6.0]]])
SKILL = np.array([[0, 0, 1], [2, 2, 2]])
WAYPOINTS = (np.zeros((2, 3)), np.ones((1, 3)))
SCRIPT = EpisodeSchedule(LATENT, SKILL, np.array([3, 2]), WAYPOINTS)


def test_episodes_come_in_turn_until_there_are_as_many_as_asked_for() -> None:
    found = SCRIPT.in_turn(5)
    assert SCRIPT.episodes == 2 and found.episodes == 5
    assert found.latent[:, 0, 0].tolist() == [1.0, 4.0, 1.0, 4.0, 1.0]
    assert found.skill[:, 2].tolist() == [1, 2, 1, 2, 1] and found.steps.tolist() == [3, 2, 3, 2, 3]
    assert [len(waypoints) for waypoints in found.waypoints] == [2, 1, 2, 1, 2]


def test_more_episodes_begin_with_the_same_ones() -> None:
    few, many = SCRIPT.in_turn(3), SCRIPT.in_turn(7)
    assert (many.latent[:3] == few.latent).all() and (many.skill[:3] == few.skill).all()


def test_fewer_than_there_are_leaves_the_last_out() -> None:
    assert SCRIPT.in_turn(1).latent.tolist() == [[[1.0], [2.0], [3.0]]]
