"""Every parameter alike: neutral changes nothing, anything else does something, the same chance gives the same outcome."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import JOINTS, blocks_env, push_env, reach_env, width

from skillcli.config.randomization import IDENTITY, PARAMETERS, Distribution, sample
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

# Values that are neither neutral nor absurd.
CHANGED = {
    "latency": 0.05, "control_jitter": 0.05, "observation_latency": 0.07, "drift_time": 1.0, "table_height": 0.005,
    "table_tilt": 0.02, "joint_noise": 0.01, "position_noise": 0.01, "joint_drift": 0.01, "position_drift": 0.01,
    "joint_offset": 0.02, "position_offset": 0.01, "push_rate": 10.0, "arm_push": 2.0, "object_push": 0.02,
    "command_restart": 0.5, "start_offset": 0.02, "object_offset": 0.02, "start_progress": 0.9,
}  # fmt: skip
# A box that is knocked about feels friction, mass and size; drift feels its time.
OVER = (0.0, 0.0294, 0.0, -2.3707, 0.0, 2.4004, 0.785)  # of the Panda, above a block
TASKS = {
    reach_env: ReachTask(),
    push_env: PushTask(),
    blocks_env: BlocksTask(start=OVER, goals=((0.5, 0.0, 0.15),), names=("lift",)),
}
OF_BLOCKS = ("object_yaw", "start_progress")  # without effect elsewhere
BUSY = {"push_rate": 20.0, "object_push": 0.05, "joint_drift": 0.001, "drift_time": 0.1}


def full(num_envs: int, values: dict[str, float]) -> dict[str, Array]:
    sizes = {name: width(name) for name in values}
    return {name: np.full(num_envs if sizes[name] == 1 else (num_envs, sizes[name]), value) for name, value in values.items()}


def ran(kind: Any, parameters: dict[str, Array] | None, seed: int = 0, threads: int = 0, steps: int = 6) -> Array:
    """What is seen and judged in some steps of two simulations."""
    env = kind(TASKS[kind], 2, threads, delay=True)
    if parameters is not None:
        env.randomize(parameters, np.random.default_rng(seed))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    seen = [np.concatenate([env.observe(), env.achieved_goal(), env.privileged()], axis=1)]
    for action in np.random.default_rng(7).uniform(-1, 1, (steps, 2, env.action_size)):
        step = env.step(action)
        seen.append(np.concatenate([step.observation, env.achieved_goal(), env.privileged()], axis=1))
    return np.stack(seen)


@pytest.fixture(scope="module", params=[reach_env, push_env])
def plain(request: pytest.FixtureRequest) -> tuple[Any, Array]:
    return request.param, ran(request.param, None)


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_neutral_value_changes_nothing_bit_for_bit(plain: tuple[Any, Array], name: str) -> None:
    kind, expected = plain
    np.testing.assert_array_equal(ran(kind, full(2, {name: IDENTITY[name]})), expected)


@pytest.fixture(scope="module")
def busy() -> Array:
    return ran(push_env, full(2, BUSY))


@pytest.mark.parametrize("name", PARAMETERS)
def test_any_other_value_changes_what_happens_or_what_is_seen(busy: Array, name: str) -> None:
    kind = blocks_env if name in OF_BLOCKS else push_env
    changed = ran(kind, full(2, {**BUSY, name: CHANGED.get(name, 1.5)}))
    assert np.isfinite(changed).all()
    before = ran(kind, full(2, BUSY)) if name in OF_BLOCKS else busy
    assert np.abs(changed - before)[..., :13].max() > 1e-6


def everything(num_envs: int) -> dict[str, Array]:
    return full(num_envs, {name: CHANGED.get(name, 1.1) for name in PARAMETERS})


def test_everything_at_once_hangs_on_the_generator_alone_and_not_on_threads() -> None:
    first = ran(push_env, everything(2), threads=1)
    np.testing.assert_array_equal(ran(push_env, everything(2), threads=2), first)
    assert (ran(push_env, everything(2), seed=1) != first).any()


def test_a_robot_that_becomes_nominal_again_is_the_plain_one() -> None:
    env = push_env(PushTask(), 2, delay=True)
    env.randomize(everything(2), np.random.default_rng(0))
    env.randomize({}, np.random.default_rng(0))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    other = push_env(PushTask(), 2, delay=True)
    for action in np.random.default_rng(7).uniform(-1, 1, (4, 2, 7)):
        np.testing.assert_array_equal(env.step(action).observation, other.step(action).observation)


@pytest.mark.slow
def test_draws_within_the_bounds_of_every_parameter_at_once_end_in_failures_and_never_in_nan() -> None:
    """As nasty as a file may be: both ends of everything, servos a thousand times too stiff, links of a hundredth."""
    ranges = {name: Distribution(kind="one_of", values=(p.low, p.high)) for name, p in PARAMETERS.items()}
    failures = 0  # nearly all of push: an arm alone stays stable in all but one of 400 robots
    for kind, task in ((reach_env, ReachTask()), (push_env, PushTask())):
        env = kind(task, 64, delay=True)
        env.randomize(sample(ranges, 64, np.random.default_rng(3), JOINTS), np.random.default_rng(4))
        env.reset(np.arange(64), np.zeros(64, dtype=np.int64))
        for action in np.random.default_rng(5).uniform(-1, 1, (20, 64, 7)):
            step = env.step(action)
            failures += int(step.terminated.sum())
            assert np.isfinite(step.observation).all() and np.isfinite(step.reward).all()
            assert np.isfinite(env.achieved_goal()).all() and np.isfinite(env.privileged()).all()
            assert env.violations().shape == (64, 3 if kind is reach_env else 5)
    assert failures > 0


def test_a_state_that_is_nan_ends_its_own_episode_only() -> None:
    env = push_env(PushTask(), 3)
    sim_states = env.save(np.arange(3))
    sim_states[1] = np.nan
    env.restore(np.arange(3), sim_states)
    step = env.step(np.zeros((3, 7)))
    assert step.terminated.tolist() == [False, True, False]
    assert np.isfinite(step.observation).all() and np.isfinite(step.reward).all()
