"""Sensors: late, off, drifting, noisy; by hand-worked numbers."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import JOINTS, reach_env

from skillcli.simulation.sensors import Sensors
from skillcli.tasks.reach.environment import ReachEnvironment
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

PERIOD = 0.05


def sensors(num_envs: int, **parameters: Array) -> Sensors:
    made = Sensors(parameters, num_envs, PERIOD, np.random.default_rng(0), JOINTS)
    made.reset(np.arange(num_envs), np.zeros((num_envs, 10)))
    return made


@pytest.mark.parametrize(("latency", "reported"), [(0.0, 6.0), (0.05, 5.0), (0.125, 3.5), (0.2, 2.0), (0.3, 0.0), (0.5, 0.0)])
def test_a_late_sensor_reports_what_was(latency: float, reported: float) -> None:
    """The true state is the number of steps since the start, 6 by now; before the start it stood at 0."""
    late = sensors(1, observation_latency=np.array([latency]))
    for step in range(1, 7):
        late.advance(np.full((1, 10), float(step)))
    np.testing.assert_allclose(late.read(), reported, atol=1e-12)


def test_each_simulation_has_its_own_latency_and_forgets_at_a_new_episode() -> None:
    late = sensors(3, observation_latency=np.array([0.0, 0.1, 0.1]))
    for step in range(1, 7):
        late.advance(np.full((3, 10), float(step)))
    late.settle(np.array([2]), np.full((1, 10), 9.0))
    assert late.read()[:, 0].tolist() == pytest.approx([6, 4, 9])


def test_drift_keeps_its_spread_and_forgets_exponentially() -> None:
    """drift_time of two periods: correlations exp(-1/2) and exp(-1) after one and two steps, spread the same for ever."""
    num_envs = 4000
    drifting = sensors(num_envs, joint_drift=np.full(num_envs, 0.02), drift_time=np.full(num_envs, 2 * PERIOD))
    seen = [drifting.read()]
    for _ in range(6):
        drifting.advance(np.zeros((num_envs, 10)))
        seen.append(drifting.read())
    joints, position = np.stack(seen)[..., :7].reshape(7, -1), np.stack(seen)[..., 7:]
    assert (position == 0).all()
    assert joints.std(axis=1) == pytest.approx(0.02, rel=0.02)
    correlation = np.corrcoef(joints)
    assert correlation[3, 4] == pytest.approx(np.exp(-0.5), abs=0.02)
    assert correlation[3, 5] == pytest.approx(np.exp(-1.0), abs=0.02)


def test_a_drift_without_memory_is_white_and_one_without_end_is_an_offset() -> None:
    for time, expected in ((0.0, 0.0), (1e6, 1.0)):
        drifting = sensors(2000, position_drift=np.full(2000, 0.01), drift_time=np.full(2000, time))
        before = drifting.read()[:, 7:].ravel()
        drifting.advance(np.zeros((2000, 10)))
        assert np.corrcoef(before, drifting.read()[:, 7:].ravel())[0, 1] == pytest.approx(expected, abs=0.05)


def test_a_drift_does_not_change_between_two_looks_at_the_same_moment() -> None:
    drifting = sensors(2, joint_drift=np.full(2, 0.02), drift_time=np.full(2, 1.0))
    np.testing.assert_array_equal(drifting.read(), drifting.read())


def environment(num_envs: int, **parameters: Array) -> ReachEnvironment:
    env = reach_env(ReachTask(), num_envs)
    env.randomize(parameters, np.random.default_rng(0))
    env.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))
    return env


def test_a_position_offset_is_seen_and_nothing_else() -> None:
    env = environment(2, position_offset=np.array([[0, 0, 0], [0.01, -0.02, 0.03]]))
    seen = env.observe()
    np.testing.assert_allclose(seen[1] - seen[0], [0] * 7 + [0.01, -0.02, 0.03], atol=1e-6)
    np.testing.assert_array_equal(env.achieved_goal()[0], env.achieved_goal()[1])


def test_an_arm_with_wrong_zeros_believes_it_is_where_it_should_be() -> None:
    """It reports the angles and the gripper position of the start, and stands elsewhere."""
    offset = np.array([[0.0] * 7, [0.02, -0.02, 0.02, 0.01, -0.01, 0.02, 0.02]])
    env = environment(2, joint_offset=offset)
    seen = env.observe()
    np.testing.assert_allclose(seen[1, :7], seen[0, :7], atol=1e-6)
    np.testing.assert_allclose(seen[1, 7:], seen[0, 7:], atol=1e-3)
    assert np.linalg.norm(env.achieved_goal()[1] - env.achieved_goal()[0]) > 0.01
    np.testing.assert_allclose(env.arms.joint_position[0] - env.arms.joint_position[1], offset[1], atol=1e-9)


def test_late_sensors_are_not_part_of_a_saved_state() -> None:
    env = environment(2, observation_latency=np.full(2, 0.1))
    for _ in range(4):
        env.step(np.ones((2, 7)))
    moved = env.save(np.array([0]))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    env.restore(np.array([1]), moved)
    now = env.observe()
    np.testing.assert_allclose(now[:, :7], env.arms.joint_position, atol=1e-6)
    assert np.abs(now[1, :7] - now[0, :7]).min() > 0.05
