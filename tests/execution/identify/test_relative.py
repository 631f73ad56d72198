"""Angles that count from an unknown start: it is found where the gripper was measured, and asked for where it was not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from execution.logs import SAWYER, recorded, small_log, wandering

from skillcli.errors import UsageError
from skillcli.execution.identify.relative import counts_from_start, from_start
from skillcli.execution.log import Log
from skillcli.simulation.replay import ForwardKinematics
from skillcli.trajectories import Array

pytestmark = pytest.mark.slow  # an arm's start is searched for

TOOL = np.array([0.01, -0.02, -0.05])  # m, in the axes of the gripper
NOISE = 0.002  # m


def relative(log: Log, off: float = 0.0) -> Log:
    """The log of an arm that counts from where it was switched on; with `off`, m, the positions are not its own."""
    place, axes = ForwardKinematics(SAWYER).frames(log.position)
    noise = NOISE * np.random.default_rng(3).standard_normal(place.shape)
    away = off * np.random.default_rng(4).standard_normal(place.shape)
    firsts = np.concatenate([np.repeat(log.position[rows][:1], rows.stop - rows.start, axis=0) for rows in log.episodes])
    sent = log.sent if log.increments else log.sent - firsts
    return replace(log, position=log.position - firsts, sent=sent, gripper_position=place + axes @ TOOL + noise + away)


def apart(found: Array, true: Array) -> Array:
    """Largest difference of each joint, rad."""
    return np.abs(found - true).max(axis=0)


@pytest.mark.parametrize("as_targets", [True, False])
def test_the_start_is_found_from_the_gripper(as_targets: bool) -> None:
    true = recorded({}, wandering(120, seed=2), as_targets=as_targets)
    told = relative(true)
    assert counts_from_start(told, SAWYER) and not counts_from_start(true, SAWYER)
    found = from_start(told, SAWYER)
    assert (apart(found.position, true.position)[:6] < 0.05).all(), "the last joint turns the gripper about itself"
    assert apart(found.sent, true.sent)[:6].max() < (0.05 if as_targets else 1e-12), "increments are the same from anywhere"
    assert found.gripper_position is None and "found from the gripper positions" in found.notes[-1]
    place, axes = ForwardKinematics(SAWYER).frames(found.position)
    assert told.gripper_position is not None
    assert np.median(np.linalg.norm(place + axes @ TOOL - told.gripper_position, axis=1)) < 0.02


def test_what_cannot_be_found_is_said() -> None:
    true = recorded({}, wandering(40, seed=2))
    with pytest.raises(UsageError, match="no gripper positions"):
        from_start(replace(true, position=true.position - true.position[0]), SAWYER)
    with pytest.raises(UsageError, match="hardly turn"):
        from_start(relative(recorded({}, np.zeros((40, 7)))), SAWYER)
    with pytest.raises(UsageError, match="no start of this arm meets"):
        from_start(relative(true, off=0.3), SAWYER)
    assert not counts_from_start(replace(small_log(), position=np.ones((7, 7))), SAWYER)
