"""The loop on an arm without physics: what it sends and records, and that whatever breaks ends in a hold, at once."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from execution.fake_arm import FakeArm

from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.execution.clock import Ticks, Watchdog
from skillcli.execution.driver import DriverError, JointState
from skillcli.execution.execute import play, slowed
from skillcli.execution.filter import LIMITED, Limits, SafetyFilter
from skillcli.execution.loop import Arm, fresh_reading
from skillcli.execution.observed import ObservedArm
from skillcli.recipe import load_recipe
from skillcli.simulation.foresight import Foresight
from skillcli.tasks.world import World
from skillcli.trajectories import Array

pytestmark = pytest.mark.real_time

PERIOD, STEPS = 0.05, 12
WORLD = World.of(load_recipe("reach"))
NAMES = WORLD.robot.description.joints


@contextmanager
def looping(driver: FakeArm, **more: Any) -> Iterator[Arm]:
    observed = ObservedArm(WORLD)
    driver.connect()
    limits = Limits.of(WORLD.robot, observed.env.arms, PERIOD)
    guard = SafetyFilter(limits, PERIOD, Foresight(WORLD.robot, observed.start).touches)
    with Watchdog(driver.hold, PERIOD) as watchdog:
        arm = Arm(driver, observed, guard, PERIOD, watchdog, **more)
        arm.begin()
        yield arm


def at_start(**more: Any) -> FakeArm:
    return FakeArm(NAMES, ObservedArm(WORLD).start, **more)


def schedule(steps: int = STEPS) -> EpisodeSchedule:
    goal = np.array([[0.5, 0.3, 0.15]])
    return EpisodeSchedule(np.zeros((1, steps, 3)), np.zeros((1, steps), dtype=int), np.array([steps]), (goal,))


def turning(observation: Array, _latent: Array) -> Array:
    """A policy: the last joint turns by half the action limit in every step."""
    return np.array([[0, 0, 0, 0, 0, 0, 0.5]])


def test_targets_are_the_start_plus_the_actions_and_come_at_the_control_rate() -> None:
    driver = at_start()
    with looping(driver) as arm:
        began = time.monotonic()
        recording = play(arm, turning, schedule(), 0)
        took = time.monotonic() - began
    assert arm.stopped is None and not driver.held
    assert took == pytest.approx(STEPS * PERIOD, abs=0.08)
    assert [command[6] for command in driver.commands] == pytest.approx(arm_start()[6] + 0.02 * np.arange(1, STEPS + 1))
    assert recording.action[0, :, 6] == pytest.approx(np.full(STEPS, 0.02)) and recording.length[0] == STEPS
    assert recording.joint_position is not None
    assert recording.joint_position[0, 1:] == pytest.approx(np.array(driver.commands), abs=0.02)
    assert len(arm.log.stamp) == STEPS + 1 and len(arm.log.sent) == STEPS == len(arm.ticks.late)
    assert not np.array(arm.log.limited).any() and np.diff(arm.log.tick) == pytest.approx(np.full(STEPS - 1, PERIOD), abs=0.03)


def arm_start() -> Array:
    return ObservedArm(WORLD).start


def test_the_state_is_estimated_from_the_last_readings_and_targets() -> None:
    driver = at_start()
    with looping(driver) as arm:
        assert not arm.estimate_state().state[0, 7:14].any(), "at rest where it begins"
        play(arm, turning, schedule(), 0)
        seen = arm.estimate_state()
        state = seen.state[0]
        assert state[:7] == pytest.approx(arm.position, abs=1e-6) and seen.achieved_goal[0] == pytest.approx(
            arm.achieved_goal()[0]
        )
        assert state[7:14] == pytest.approx([0, 0, 0, 0, 0, 0, 0.4], abs=0.1), "0.02 rad in 50 ms"
        assert np.diff(state[14:].reshape(4, 7)[:, 6]) == pytest.approx([0.02] * 3), "the last four targets"
        arm.begin()
        assert not arm.estimate_state().state[0, 7:14].any(), "another episode"


def test_half_the_speed_is_half_of_every_action_for_twice_as_long() -> None:
    driver, slow = at_start(), slowed(schedule(), 0.5)
    with looping(driver, share=0.5) as arm:
        play(arm, turning, slow, 0)
    assert len(driver.commands) == 2 * STEPS
    assert np.diff([command[6] for command in driver.commands]) == pytest.approx(np.full(2 * STEPS - 1, 0.01))
    assert driver.target[6] == pytest.approx(arm_start()[6] + 0.02 * STEPS)


def test_a_dry_run_sends_nothing() -> None:
    driver = at_start()
    with looping(driver, dry=True) as arm:
        play(arm, turning, schedule(), 0)
    assert not driver.commands and len(arm.log.commanded) == STEPS


def broken_after(count: int, **changes: Any) -> FakeArm:
    return at_start(change=lambda state, commands: replace(state, **changes) if commands > count else state)


def lost(state: JointState, commands: int) -> JointState:
    if commands > 3:
        raise DriverError("the cable is out")
    return state


def stuck() -> FakeArm:
    seen: list[JointState] = []

    def change(state: JointState, commands: int) -> JointState:
        if commands <= 3:
            seen[:] = [state]
        return seen[0]

    return at_start(change=change)


def frozen() -> FakeArm:
    seen: list[JointState] = []

    def change(state: JointState, commands: int) -> JointState:
        if commands <= 3:
            seen[:] = [state]
        return replace(seen[0], stamp=state.stamp)

    return at_start(change=change)


BREAKS = {
    "not_finite": lambda: broken_after(3, position=np.full(7, np.nan)),
    "joint_names": lambda: broken_after(3, names=(NAMES[1], NAMES[0], *NAMES[2:])),
    "clock_jump": lambda: broken_after(3, stamp=1.0),
    "jumped_reading": lambda: broken_after(3, position=arm_start() + 1.0),
    "stale_reading": stuck,
    "frozen_reading": frozen,
    "driver_lost": lambda: at_start(change=lost),
}


@pytest.mark.parametrize("reason", BREAKS)
def test_whatever_breaks_ends_in_a_hold_within_a_control_period(reason: str) -> None:
    driver = BREAKS[reason]()
    with looping(driver) as arm:
        recording = play(arm, lambda *_: np.array([[0, 0, 0, 0, 0, 0, 1.0]]), schedule(), 0)
    assert arm.stopped is not None and arm.stopped.reason == reason and arm.stopped.message
    assert len(driver.held) >= 1 and len(driver.commands) <= 5
    assert driver.held[0] - arm.log.sent[3] <= PERIOD + 0.02, "the fault began when the fourth target was sent"
    assert not recording.success[0] and len(recording.time) < STEPS
    assert len(driver.commands) == np.count_nonzero(np.abs(recording.action[0]).max(axis=1))


def test_a_request_to_stop_ends_in_a_hold_before_another_target_is_sent() -> None:
    driver = at_start()
    with looping(driver, stop_asked=lambda: len(driver.commands) == 5) as arm:
        recording = play(arm, turning, schedule(), 0)
    assert arm.stopped is not None and arm.stopped.reason == "interrupted"
    assert len(driver.commands) == 5 and len(driver.held) == 1 and not recording.success[0]


def test_the_watchdog_holds_while_a_driver_hangs() -> None:
    def slow(state: JointState, commands: int) -> JointState:
        if commands == 4 and not driver.held:
            time.sleep(0.3)
        return state

    driver = at_start(change=slow)
    with looping(driver) as arm:
        play(arm, turning, schedule(), 0)
        assert arm.stopped is not None and arm.stopped.reason == "watchdog"
    assert driver.held[0] - arm.log.sent[3] < 0.15, "before the driver came back"
    assert len(driver.commands) == 4


def test_a_filtered_target_is_recorded_with_its_reason() -> None:
    driver = at_start()
    with looping(driver) as arm:
        arm.go(arm.target + np.array([0, 0, 0, 0, 0, 0, 9.0]))
    limited = np.array(arm.log.limited)[0]
    assert {name for name, yes in zip(LIMITED, limited, strict=True) if yes} >= {"tracking"}
    assert arm.log.asked[0][6] - arm.log.commanded[0][6] > 8


def test_an_old_reading_is_none_to_begin_with() -> None:
    old = time.monotonic() - 5
    driver = at_start(change=lambda state, _: replace(state, stamp=old))
    with pytest.raises(DriverError, match=r"no new reading of the joints came within 0\.1 s: the newest is 5"):
        fresh_reading(driver, within=0.1)


def test_ticks_that_are_over_are_left_out() -> None:
    ticks = Ticks(0.02)
    ticks.begin()
    first = ticks.tick
    time.sleep(0.05)
    ticks.answered()
    ticks.wait()
    assert (ticks.tick - first) / 0.02 == pytest.approx(2, abs=0.01)
    assert ticks.missed() == 1 and ticks.late[0] == pytest.approx(0.05, abs=0.02)
