"""The safety filter: numbers worked out by hand, and limits that no target breaks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skillcli.execution.driver import JointState
from skillcli.execution.filter import LIMITED, Limits, SafetyFilter
from skillcli.recipe import load_recipe
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.tasks.world import World
from skillcli.trajectories import Array

PERIOD = 0.05
TWO = Limits(
    low=np.array([-1.0, -0.5]),
    high=np.array([1.0, 0.5]),
    speed=np.array([1.0, 2.0]),
    acceleration=np.array([8.0, 4.0]),
    lead=0.2,
)  # in a step: 0.05 and 0.1 rad, changed by 0.02 and 0.01 rad


def state(position: Array | list[float], stamp: float = 10.0, names: tuple[str, ...] = ("a", "b")) -> JointState:
    return JointState(names, np.array(position, dtype=float), np.zeros(len(names)), stamp)


def begun(position: list[float] | None = None, limits: Limits = TWO, touched: str = "", beyond: float = np.inf) -> SafetyFilter:
    """A filter of an arm that touches something where its first joint is beyond an angle."""
    found = SafetyFilter(limits, PERIOD, lambda angles: touched if angles[0] > beyond else "")
    found.begin(state(position or [0.0, 0.0]))
    return found


def test_what_keeps_every_limit_passes_unchanged() -> None:
    passed = begun().limit(np.array([0.02, -0.01]), np.zeros(2))
    assert passed.target == pytest.approx([0.02, -0.01]) and not passed.why


def test_the_first_step_is_what_the_acceleration_allows_and_the_second_twice_that() -> None:
    guard = begun()
    first = guard.limit(np.array([0.1, 0.0]), np.zeros(2))
    assert first.target == pytest.approx([0.02, 0.0]) and "joint_acceleration" in first.why
    assert guard.limit(np.array([0.15, 0.0]), np.zeros(2)).target == pytest.approx([0.06, 0.0])


def test_no_step_is_longer_than_the_speed_allows() -> None:
    guard, before = begun(), 0.0
    for _ in range(5):
        passed = guard.limit(np.array([1.0, 0.0]), np.array([before, 0.0]))
        step, before = passed.target[0] - before, passed.target[0]
    assert step == pytest.approx(0.05) and "joint_speed" in passed.why


def test_a_joint_brakes_in_time_and_stops_at_the_end_of_its_range() -> None:
    guard, path = begun([0.6, 0.0]), [0.6]
    for _ in range(40):
        path.append(float(guard.limit(np.array([5.0, 0.0]), np.array([path[-1], 0.0])).target[0]))
    steps = np.diff(path)
    assert max(path) <= 1.0 and path[-1] == pytest.approx(1.0)
    assert np.abs(np.diff(steps)).max() <= 0.02 + 1e-9


def test_accelerations_are_those_of_the_robot_file_else_a_turn_round_within_a_step() -> None:
    for recipe, expected in (("reach-panda", [15, 7.5, 10, 12.5, 15, 20, 20]), ("reach", [2 * 0.04 / PERIOD**2] * 7)):
        world = World.of(load_recipe(recipe))
        env = world.make_env(1, threads=1)
        assert isinstance(env, ArmEnvironment)
        for share in (1.0, 0.2):
            limits = Limits.of(world.robot, env.arms, PERIOD, share)
            assert limits.acceleration == pytest.approx(share * np.array(expected))


def test_a_target_leads_its_joint_by_no_more_than_the_lead() -> None:
    wide = Limits(low=-np.ones(1) * 9, high=np.ones(1) * 9, speed=np.ones(1) * 99, acceleration=np.ones(1) * 9999, lead=0.2)
    guard = SafetyFilter(wide, PERIOD, lambda _: "")
    guard.begin(state([0.0], names=("a",)))
    passed = guard.limit(np.array([0.5]), np.array([0.1]))
    assert passed.target == pytest.approx([0.3]) and passed.why == {"tracking"}


def test_a_step_from_which_the_arm_could_not_brake_before_it_touches_is_refused() -> None:
    guard = begun([0.0, 0.0], touched="table_clearance", beyond=0.075)
    targets = [guard.limit(np.array([1.0, 0.0]), np.zeros(2)) for _ in range(4)]
    # 0.02, then 0.06 with 0.02 of braking behind it is beyond: brake from 0.02 by 0.02
    assert [passed.target[0] for passed in targets] == pytest.approx([0.02, 0.02, 0.04, 0.04])
    assert targets[1].why >= {"table_clearance"} and "table_clearance" not in targets[0].why


def test_a_joint_beyond_its_range_only_comes_back() -> None:
    guard = begun([1.1, 0.0])
    assert guard.limit(np.array([1.2, 0.0]), np.array([1.1, 0.0])).target[0] == pytest.approx(1.1)
    assert guard.limit(np.array([1.0, 0.0]), np.array([1.1, 0.0])).target[0] == pytest.approx(1.08)


def test_a_target_that_is_no_number_is_no_reason_to_move() -> None:
    assert begun().limit(np.array([np.nan, 0.01]), np.zeros(2)).target == pytest.approx([0.0, 0.01])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=60),
    st.tuples(st.floats(-1, 1), st.floats(-0.5, 0.5)),
    st.floats(-1.2, 1.2),
)
def test_no_targets_whatever_lead_beyond_a_limit(
    wanted: list[tuple[float, float]], start: tuple[float, float], wall: float
) -> None:
    wall = max(wall, start[0])  # it begins where it touches nothing
    guard = begun(list(start), touched="self_collision", beyond=wall)
    path, step = np.array(start), np.zeros(2)
    for asked in wanted:
        passed = guard.limit(path + np.array(asked), path)
        following = passed.target - path
        assert (passed.target >= TWO.low - 1e-9).all() and (passed.target <= TWO.high + 1e-9).all()
        assert (np.abs(following) <= TWO.speed * PERIOD + 1e-9).all()
        assert (np.abs(following - step) <= TWO.acceleration * PERIOD**2 + 1e-9).all()
        assert passed.target[0] <= wall + 1e-9 and passed.why <= set(LIMITED)
        path, step = passed.target, following


@pytest.mark.parametrize(
    ("reading", "now", "reason"),
    [
        (state([0.0, 0.0], 10.05), 10.051, None),
        (state([0.0, 0.0], 10.05, ("b", "a")), 10.051, "joint_names"),
        (state([np.nan, 0.0], 10.05), 10.051, "not_finite"),
        (state([0.0, 0.0], 9.0), 10.051, "clock_jump"),
        (state([0.0, 0.0], 70.0), 10.051, "clock_jump"),
        (state([0.0, 0.0], 10.0), 10.03, None),
        (state([0.0, 0.0], 10.0), 10.04, "stale_reading"),
        (state([0.0, 0.0], 10.05), 10.09, "stale_reading"),
        (state([0.16, 0.0], 10.05), 10.051, "jumped_reading"),
    ],
)
def test_readings_that_cannot_be_trusted_stop_the_arm(reading: JointState, now: float, reason: str | None) -> None:
    stop = begun().judge(reading, now)
    assert (stop.reason if stop else None) == reason
    assert stop is None or (stop.message and "\n" not in stop.message)


def test_an_arm_that_stands_still_to_the_last_bit_while_it_moved_is_not_believed() -> None:
    guard = begun()
    guard.limit(np.array([0.02, 0.0]), np.zeros(2))
    assert guard.judge(state([0.014, 0.0], 10.05), 10.05) is None
    stop = guard.judge(state([0.014, 0.0], 10.10), 10.10)
    assert stop is not None and stop.reason == "frozen_reading"


def test_an_arm_far_behind_its_target_does_not_follow() -> None:
    guard, stamp, stop = begun(), 10.0, None
    for _ in range(20):
        guard.limit(guard.target + 0.05, np.array([0.0, 0.0]) + guard.target)  # it says that it follows
        stamp += 0.05
        stop = stop or guard.judge(state([0.0, 0.0], stamp), stamp)
    assert stop is not None and stop.reason == "not_following"
