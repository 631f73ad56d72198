"""Late commands, and external forces."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import SAWYER, push_env, reach_env

from skillcli.simulation.disturbance import Disturbance
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask


def test_latency_is_spread_evenly_up_to_the_stated_time() -> None:
    jitter = np.repeat([0.0, 0.02, 0.2], 3000)
    late = Disturbance({"control_jitter": jitter}, 9000, 10, 0.05, np.random.default_rng(0)).latency()
    assert late is not None
    assert (late[:3000] == 0).all()
    assert np.bincount(late[3000:6000], minlength=5) == pytest.approx(600, abs=100), "0 to 4 physics steps of 5 ms"
    assert late[6000:].max() == 10, "never later than the next command"


def test_without_jitter_or_forces_nothing_is_drawn() -> None:
    rng = np.random.default_rng(0)
    quiet = Disturbance({"control_jitter": np.zeros(2), "push_rate": np.zeros(2)}, 2, 10, 0.05, rng)
    assert quiet.latency() is None and quiet.forces() is None
    assert rng.random() == np.random.default_rng(0).random()


def test_a_late_command_leaves_the_old_one_in_force_until_then() -> None:
    """By hand: three physics steps of the old command, seven of the new one; and none of it for one ten steps late."""
    env, hand = reach_env(ReachTask(), 3), reach_env(ReachTask(), 1)
    env.arms.step(np.full((3, 7), 0.04), np.array([0, 3, 10]))
    old = hand.arms.batch.bind("ctrl").copy()
    hand.arms.batch.step(nstep=3)
    hand.arms.batch.bind("ctrl")[:] = old + 0.04
    hand.arms.batch.step(nstep=7)
    np.testing.assert_array_equal(env.arms.joint_position[1], hand.arms.joint_position[0])
    at_once, late, next_time = env.arms.joint_position - np.array(SAWYER.start("reach"))
    assert (at_once > late).all() and (late > 0.004).all() and np.abs(next_time).max() < 1e-4


def test_no_command_is_lost() -> None:
    env = reach_env(ReachTask(), 2)
    env.randomize({"control_jitter": np.array([0.0, 0.05])}, np.random.default_rng(0))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    action = np.concatenate([np.ones((5, 2, 7)), np.zeros((15, 2, 7))])
    for row in action:
        env.step(row)
    np.testing.assert_allclose(env.arms.joint_position[0], env.arms.joint_position[1], atol=2e-3)


def test_forces_come_as_often_as_stated_with_the_stated_impulse() -> None:
    """Two a second and control steps of 50 ms: a step has one with probability 1 - exp(-0.1)."""
    num_envs = 20_000
    parameters = {
        "push_rate": np.full(num_envs, 2.0),
        "arm_push": np.full(num_envs, 1.5),
        "object_push": np.full(num_envs, 0.1),
    }
    forces = Disturbance(parameters, num_envs, 10, 0.05, np.random.default_rng(0)).forces()
    assert forces is not None
    for force, impulse in zip(forces, (1.5, 0.1), strict=True):
        size = np.linalg.norm(force, axis=1)
        assert (size > 0).mean() == pytest.approx(1 - np.exp(-0.1), rel=0.1)
        assert size[size > 0] * 0.05 == pytest.approx(impulse)
        assert np.abs((force[size > 0] / size[size > 0, None]).mean(axis=0)).max() < 0.1, "in all directions"
    assert (forces[1][:, 2] == 0).all(), "a box is pushed along the table"


def test_a_force_gives_the_box_its_momentum_and_ends() -> None:
    """5 N for 50 ms on 0.3 kg are 0.83 m/s, but for a little friction: 0.006 of its weight."""
    env = push_env(PushTask(), 2)
    env.randomize({"contact_friction": np.full(2, 0.01)}, np.random.default_rng(0))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    env.arms.apply_external_force(np.zeros((2, 3)), np.array([[0, 0, 0], [0.0, 5.0, 0]]))
    env.arms.step(np.zeros((2, 7)))
    env.arms.release()
    assert env.arms.object_velocity[:, 1].tolist() == pytest.approx([0, 5 * 0.05 / 0.3], rel=0.03, abs=1e-3)
    before = env.arms.object_velocity[1, 1]
    env.arms.step(np.zeros((2, 7)))
    assert env.arms.object_velocity[1, 1] == pytest.approx(before, rel=0.02)


def test_a_saved_state_holds_no_force() -> None:
    env = push_env(PushTask(), 1)
    parameters = {"push_rate": np.array([20.0]), "arm_push": np.array([5.0])}
    env.randomize(parameters, np.random.default_rng(0))
    for _ in range(5):
        env.step(np.zeros((1, 7)))
    assert (env.arms.batch.bind("xfrc_applied") == 0).all()
