"""Recordings and their judgement, on a world where a latent is a velocity."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from skillcli.evaluation.rollouts import rollout, rollout_waypoints
from skillcli.trajectories import Array, Trajectories


class Line:
    """N points on a line; simulation i fails in the step after `fails[i]` steps."""

    control_period, tolerance = 0.5, 0.1

    def __init__(self, targets: list[float], fails: dict[int, int] | None = None) -> None:
        self.num_envs = len(targets)
        self.desired_goal = np.array([[t, 0.0, 0.0] for t in targets])
        self.x = np.zeros(self.num_envs)
        self.applied = np.zeros((self.num_envs, 1))
        self.fails, self.taken = fails or {}, 0
        self.unstable = np.zeros(self.num_envs, dtype=bool)

    def observe(self) -> Array:
        return self.x[:, None].astype(np.float32)

    def achieved_goal(self) -> Array:
        return np.stack([self.x, 0 * self.x, 0 * self.x], axis=1)

    def violations(self) -> Array:
        return np.stack([self.x > 1.5, self.x < 0], axis=1)

    def recorded_state(self) -> dict[str, Array]:
        return {"gripper_position": self.achieved_goal()}

    def step(self, action: Array) -> Any:
        self.taken += 1
        self.applied = action
        self.x = self.x + action[:, 0]
        terminated = np.array([self.fails.get(i) == self.taken for i in range(self.num_envs)])
        return SimpleNamespace(observation=self.observe(), reward=-self.x, terminated=terminated)


def act(observation: Array, latent: Array) -> Array:
    return latent


def held(*velocity: float, steps: int = 4) -> tuple[Array, Array]:
    return np.repeat(np.array(velocity)[:, None, None], steps, axis=1), np.zeros((len(velocity), steps), dtype=int)


def test_success_is_the_end_within_the_tolerance_without_any_failure() -> None:
    # arrives; passes and goes on; arrives but failed on the way; does not arrive
    env = Line([4.05, 2.0, 4.0, 4.2], fails={2: 2})
    recording, _ = rollout(env, act, *held(1, 1, 1, 1))
    assert recording.success.tolist() == [True, False, False, False]
    assert recording.length.tolist() == [4, 4, 2, 4]


def test_a_point_of_a_tasks_own_is_judged_where_it_is() -> None:
    """A box that is lifted: the usual judged point, the box in the plane of the table, would never leave it."""

    class Lift(Line):
        def achieved_goal(self) -> Array:
            return np.stack([0 * self.x, 0 * self.x, self.x], axis=1)

        def recorded_state(self) -> dict[str, Array]:
            return {"object_pose": np.concatenate([self.achieved_goal(), np.tile([1.0, 0, 0, 0], (self.num_envs, 1))], axis=1)}

    env = Lift([0.0, 0.0])
    env.desired_goal[1, 2] = 4.0
    recording, _ = rollout(env, act, *held(1, 1))
    assert recording.success.tolist() == [False, True]
    np.testing.assert_allclose(recording.achieved_goal[:, :, 2], [[0, 1, 2, 3, 4]] * 2)
    usual, _ = rollout(Line([4.0]), act, *held(1))
    assert usual.judged_position is None, "nothing new to say, nothing stored"
    joined = Trajectories.join([recording.select(slice(0, 1)), recording.padded(6)])
    assert joined.judged_position is not None and joined.achieved_goal.shape == (3, 7, 3)


def test_a_simulation_that_comes_apart_is_told_from_one_that_fails() -> None:
    env = Line([4.0, 4.0, 4.0], fails={0: 2, 1: 3})
    env.unstable[1] = True
    recording, _ = rollout(env, act, *held(1, 1, 1))
    assert recording.stable.tolist() == [True, False, True] and recording.success.tolist() == [False, False, True]
    assert rollout(Line([4.0], fails={0: 1}), act, *held(1))[0].unstable is None


def test_only_the_first_failure_ends_an_episode() -> None:
    env = Line([0.0])
    env.step_before = env.step  # type: ignore[attr-defined]

    def failing(action: Array) -> Any:
        step = env.step_before(action)  # type: ignore[attr-defined]
        return SimpleNamespace(**{**vars(step), "terminated": np.array([env.taken >= 2])})

    env.step = failing  # type: ignore[method-assign]
    assert rollout(env, act, *held(1))[0].length.tolist() == [2]


def test_a_recording_holds_every_step_on_one_clock() -> None:
    recording, observation = rollout(Line([4.0, 0.0]), act, *held(1, 0.5))
    assert recording.time.tolist() == [0, 0.5, 1, 1.5, 2]
    assert recording.gripper_position is not None
    assert recording.gripper_position[1, :, 0].tolist() == [0, 0.5, 1, 1.5, 2]
    assert recording.action[0, :, 0].tolist() == [1, 1, 1, 1] and recording.reward[0].tolist() == [-1, -2, -3, -4]
    assert observation.shape == (2, 5, 1) and observation[1, -1, 0] == 2


def test_latents_may_change_along_the_way() -> None:
    latent = np.array([[[1.0], [1.0], [-1.0], [0.0]]])
    recording, _ = rollout(Line([1.0]), act, latent, np.array([[0, 0, 1, -1]]))
    assert recording.success.tolist() == [True] and recording.skill.tolist() == [[0, 0, 1, -1]]


def test_waypoints_must_be_met_in_order_and_the_last_one_held() -> None:
    def achieved_goal(path: list[float], *waypoints: float) -> bool:
        velocity = np.diff([0.0, *path])[None, :, None]
        line = np.array([[x, 0.0, 0.0] for x in waypoints])
        recording = rollout_waypoints(Line([99.0]), act, velocity, np.zeros((1, len(path)), dtype=int), [line])
        np.testing.assert_array_equal(recording.target, line[-1:])
        return bool(recording.success[0])

    assert achieved_goal([1, 2, 1], 2, 1)
    assert achieved_goal([1, 2, 3], 1, 2, 3)
    assert not achieved_goal([1, 2, 3], 2, 1), "the second was passed before the first"
    assert not achieved_goal([2, 1, 3], 2, 1), "met, and left again"
    assert not achieved_goal([1, 3], 2, 3), "the first was missed"


def test_a_failed_episode_keeps_its_last_state_and_earns_nothing_more() -> None:
    env = Line([9.0, 9.0], fails={1: 2})
    recording, _ = rollout(env, lambda _, latent: latent, np.ones((2, 4, 1)), np.zeros((2, 4), dtype=int))
    assert recording.gripper_position is not None
    assert recording.gripper_position[:, :, 0].tolist() == [[0, 1, 2, 3, 4], [0, 1, 1, 1, 1]]
    assert recording.reward.tolist() == [[-1, -2, -3, -4], [-1, -2, 0, 0]]
    assert recording.action[1, :, 0].tolist() == [1, 1, 0, 0]
    assert recording.length.tolist() == [4, 2]


def test_an_episode_that_gets_fewer_steps_rests_in_its_own_last_state_while_the_simulation_runs_on() -> None:
    env = Line([2.0, 2.0, 4.0])
    recording, observation = rollout(env, act, *held(1, 1, 1), np.array([2, 4, 4]))
    assert recording.length.tolist() == [2, 4, 4]
    assert recording.success.tolist() == [True, False, True], "each at its own end"
    assert recording.gripper_position is not None
    assert recording.gripper_position[0, :, 0].tolist() == [0, 1, 2, 2, 2]
    assert recording.action[0, :, 0].tolist() == [1, 1, 0, 0] and recording.reward[0].tolist() == [-1, -2, 0, 0]
    assert env.x.tolist() == [4, 4, 4] and observation[0, :, 0].tolist() == [0, 1, 2, 3, 4]


def test_a_failure_behind_an_episodes_own_end_does_not_count() -> None:
    steps = np.array([2, 3])
    recording, _ = rollout(Line([2.0, 3.0], fails={0: 3, 1: 3}), act, *held(1, 1), steps)
    assert recording.success.tolist() == [True, False]
    assert recording.length.tolist() == [2, 3] and steps.tolist() == [2, 3], "what was asked is left alone"


def test_each_simulation_has_its_own_waypoints_and_its_own_end() -> None:
    def on(*x: float) -> Array:
        return np.array([[each, 0.0, 0.0] for each in x])

    env, steps = Line([0.0, 0.0, 0.0]), np.array([2, 4, 2])
    recording = rollout_waypoints(env, act, *held(1, 1, 1), [on(1, 2), on(1, 3, 4), on(3)], steps)
    np.testing.assert_array_equal(recording.target[:, 0], [2, 4, 3])
    assert recording.success.tolist() == [True, True, False], "the third is passed only behind the end"


def test_steps_beyond_a_limit_are_counted_while_an_episode_runs() -> None:
    """At one metre a step, step 2 and every later one ends beyond 1.5 m; the second episode has only three of them."""
    recording, _ = rollout(Line([4.0, 4.0, 0.0]), act, *held(1, 1, -1), np.array([4, 3, 4]))
    assert recording.violations is not None
    assert recording.violations.tolist() == [[3, 0], [2, 0], [0, 4]]
    assert recording.select([1]).violations.tolist() == [[2, 0]]  # type: ignore[union-attr]
    assert recording.violated is not None
    assert recording.violated[:, :, 0].tolist() == [[False, True, True, True], [False, True, True, False], [False] * 4]
    assert recording.violated[:, :, 1].tolist() == [[False] * 4, [False] * 4, [True] * 4]
    assert recording.first_violations == [{"joint_range": 1}, {"joint_range": 1}, {"joint_speed": 0}]


def test_where_nothing_is_broken_only_the_counts_say_so() -> None:
    kept, _ = rollout(Line([1.0]), act, *held(0.25))
    assert kept.violations is not None and kept.violations.tolist() == [[0, 0]]
    assert kept.violated is None and kept.first_violations == [{}]
    broken, _ = rollout(Line([4.0]), act, *held(1, steps=2))
    joined = Trajectories.join([kept, broken])
    assert joined.violated is not None and joined.violated.shape == (2, 4, 2)
    assert joined.first_violations == [{}, {"joint_range": 1}]
    np.testing.assert_array_equal(joined.violated.sum(axis=1), joined.violations), "what is added breaks nothing"
