"""The composer's problem as episodes: an action is a latent of a stored library, held for a segment.

It is the decision process of `skillcli.composition.episodes` with one waypoint: same observations, rewards and ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from skillcli.composition.episodes import FAILED, EpisodeSettings
from skillcli.composition.latent_bounds import LatentBounds, bounds_of
from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.route import STRAIGHT, CostToGo, Route
from skillcli.evaluation.library import Library
from skillcli.gym.episodes import GoalChoice, Observations, Played, box
from skillcli.tasks.registry import cost_to_go
from skillcli.trajectories import SAFETY_LIMITS, Array

DETOUR_WEIGHT = Route.detour_weight


class LatentEpisodes:
    """See `Episodes`.

    Observation: that of the robot, then the task's keypoints (the gripper, or box and gripper) less the goal, m. Action:
    a latent, in units of the box of two standard deviations around all means. Reward: minus the mean remaining cost over the
    control steps of the segment, m, times `reward_scale`. Terminated: the goal is met, or the simulation failed or violated a
    safety limit, which counts as 5 m.

    Args:
        library: the skills.
        settings: segment, length of an episode, tolerance, scale of the reward.
        num_envs: N.
        threads: of the engine, 0 for all cores.
    """

    def __init__(self, library: Library, settings: EpisodeSettings, num_envs: int, threads: int) -> None:
        self.world, self.num_envs, self._settings = library.world, num_envs, settings
        env = library.world.make_env(num_envs, threads)
        period = float(env.control_period)
        self._steps = max(1, round(settings.segment / period))
        self._segments = max(1, round(settings.seconds / (self._steps * period)))
        self.control_period = self._steps * period
        self._world = LatentEnvironment(env, library.agent.act, limits=SAFETY_LIMITS)
        self._cost: CostToGo = cost_to_go(library.recipe.task) or STRAIGHT
        self.bounds = LatentBounds(bounds_of(library.mean, library.std))
        self.goals = GoalChoice(library.world)
        self._start, self._start_keypoints = self._world.start()
        self._start_observation = self._world.observe(self._start)
        size = self._start_observation.shape[1] + self._start_keypoints[0].size
        self.observation_space: spaces.Space[Any] = box(size)
        self.action_space = box(library.mean.shape[1], 1.0)
        self._state = np.tile(self._start, (num_envs, 1))
        self._keypoints = np.tile(self._start_keypoints, (num_envs, 1, 1))
        self._seen = np.tile(self._start_observation, (num_envs, 1))
        self._goal, self._elapsed = np.zeros((num_envs, 3)), np.zeros(num_envs, dtype=np.int64)

    def begin(self, ids: Array, goals: Array) -> None:
        """See `Episodes`."""
        self._state[ids], self._keypoints[ids], self._seen[ids] = self._start, self._start_keypoints, self._start_observation
        self._goal[ids], self._elapsed[ids] = goals, 0

    def observe(self) -> Observations:
        """See `Episodes`."""
        gap = self._keypoints - self._goal[:, None]
        return np.concatenate([self._seen, gap.reshape(self.num_envs, -1)], axis=1, dtype=np.float32, casting="same_kind")

    def step(self, action: Array, running: Array | None) -> Played:
        """See `Episodes`."""
        ids = np.arange(self.num_envs) if running is None else running
        outcome = self._world.hold(self._state[ids], self.bounds.latent(action[ids]), self._steps)
        self._elapsed[ids] += 1
        distance, reward = np.zeros(self.num_envs), np.zeros(self.num_envs)
        failed, arrived = np.zeros(self.num_envs, dtype=bool), np.zeros(self.num_envs, dtype=bool)
        reward[ids], failed[ids], arrived[ids], distance[ids] = self._judge(outcome, self._goal[ids])
        kept, whole = ids[~failed[ids]], ~failed[ids]  # a failed episode keeps its last valid state
        self._state[kept], self._keypoints[kept] = outcome.sim_states[whole], outcome.path[whole, 0, -1]
        self._seen[kept] = outcome.observation[whole, 0]
        return Played(reward, failed | arrived, self._elapsed >= self._segments, distance, arrived)

    def _judge(self, outcome: Outcome, goal: Array) -> tuple[Array, Array, Array, Array]:
        """Return rewards (n,), which episodes failed and which arrived, (n,) bool, and their nearest distances, (n,) m."""
        path, failed, settings = outcome.path[:, 0, 1:], outcome.failed[:, 0], self._settings
        target = goal[:, None]
        distance = np.linalg.norm(path[..., 0, :] - target, axis=-1)  # (n, T)
        there = distance <= settings.goal_tolerance
        arrived = there.any(axis=1) & ~failed
        cost = self._cost.distance(path, target) + DETOUR_WEIGHT * self._cost.detour(path, target)
        under_way = ~np.logical_or.accumulate(there, axis=1)
        mean = (cost * under_way).sum(axis=1) / self._steps
        reward = -settings.reward_scale * np.where(failed, FAILED, mean)
        return reward, failed, arrived, np.where(arrived, distance.min(axis=1), distance[:, -1])
