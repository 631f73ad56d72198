"""Episodes of a task, straight on the batch engine."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from skillcli.gym.episodes import GoalChoice, Observations, Played, box
from skillcli.simulation.environment import NO_SKILL
from skillcli.tasks.world import World
from skillcli.trajectories import Array


class TaskEpisodes:
    """See `Episodes`. An observation is that of the task, then the way from the achieved to the desired goal, (3,) m.

    Args:
        world: task and robot.
        num_envs: N.
        threads: of the engine, 0 for all cores; results do not depend on it.
        goal_conditioned: whether observations are dictionaries with `achieved_goal` and `desired_goal`, and the reward is
            1 within the tolerance of the goal and 0 elsewhere, instead of the task's own.
    """

    def __init__(self, world: World, num_envs: int, threads: int, goal_conditioned: bool = False) -> None:
        self.world, self.num_envs, self._conditioned = world, num_envs, goal_conditioned
        self.env = env = world.make_env(num_envs, threads)
        self.control_period, self.goals = float(env.control_period), GoalChoice(world)
        self.action_space = box(env.action_size, 1.0)
        size = env.observation_size
        self._size = size
        parts: dict[str, spaces.Space[Any]] = {
            "observation": box(size), "achieved_goal": box(3, dtype=np.float64), "desired_goal": box(3, dtype=np.float64),
        }  # fmt: skip
        self.observation_space: spaces.Space[Any] = spaces.Dict(parts) if goal_conditioned else box(size + 3)
        self._seen = env.observe()
        self._achieved = env.achieved_goal()

    def begin(self, ids: Array, goals: Array) -> None:
        """See `Episodes`."""
        self.env.reset(ids, np.full(len(ids), NO_SKILL))
        self.env.desired_goal[ids] = goals
        self._seen, self._achieved = self.env.observe(), self.env.achieved_goal()

    def observe(self) -> Observations:
        """See `Episodes`."""
        desired = self.env.desired_goal
        if self._conditioned:
            return {"observation": self._seen.copy(), "achieved_goal": self._achieved.copy(), "desired_goal": desired.copy()}
        observation = np.empty((self.num_envs, self._size + 3), dtype=np.float32)
        observation[:, : self._size] = self._seen
        np.subtract(desired, self._achieved, out=observation[:, self._size :], casting="same_kind")
        return observation

    def step(self, action: Array, running: Array | None) -> Played:
        """See `Episodes`."""
        env = self.env
        env.set_active(running)
        step = env.step(action)
        self._seen, self._achieved = step.observation, env.achieved_goal()
        gap = self._achieved - env.desired_goal
        distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        success = (distance <= env.tolerance) & ~step.terminated  # the engine has put what failed back to the start
        reward = success.astype(float) if self._conditioned else step.reward
        return Played(reward, step.terminated, step.truncated, distance, success)
