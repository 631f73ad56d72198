"""The point task: a position in the plane, moved by velocity. It tests the method without physics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from skillcli.robots.robot import Robot
from skillcli.simulation.chance import Chance, Rng
from skillcli.simulation.environment import Array, ObservationTerm, StateEstimate, Step
from skillcli.tasks.point.settings import PointTask

SMALLEST = 1e-12  # smallest gain to divide by: with zero gain nothing moves


class PointEnvironment:
    """N points that start at the origin.

    Observation (2): the position, m. Action (2): a move in units of the step limit. Reward: minus the distance to the
    goal, m.
    """

    observation_size = 2
    action_size = 2
    privileged_size = 0
    reward_names = ("distance",)
    privileged_terms: ClassVar[tuple[ObservationTerm, ...]] = ()
    recorded: ClassVar[Mapping[str, int]] = {"position": 2}

    def __init__(
        self, task: PointTask, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False
    ) -> None:
        self.robot, self.joints = robot, robot.joint_count  # not used
        self.num_envs, self.horizon, self.tolerance = num_envs, task.horizon, task.tolerance
        self.control_period = task.control_period
        self._step_limit = task.step_limit
        self._gain: Array = np.ones((num_envs, 1))
        self._bound = task.bound
        self._noise: Array | None = None  # sensor noise of a transfer domain, (N, 1) m
        self._chance = Chance(np.random.default_rng(0))
        self.goals = goals
        self.desired_goal = np.zeros((num_envs, 3))
        self._position = np.zeros((num_envs, 2))
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self.applied, self.unstable = np.zeros((num_envs, 2)), np.zeros(num_envs, dtype=bool)

    @classmethod
    def observation_terms(cls, task: PointTask, joints: int) -> tuple[ObservationTerm, ...]:
        """Return the terms of the observation in order."""
        return (ObservationTerm("position", "m", 2, "of the plane: episodes start at the origin"),)

    @classmethod
    def scene(cls, task: PointTask, robot: Robot, delay: bool = False) -> None:
        """Return None: no engine simulates this task."""

    def reset(self, ids: Array, skill: Array) -> None:
        """See `Environment`."""
        self.reset_to_state(ids, np.zeros((len(ids), 2)), skill)

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """See `Environment`."""
        self.restore(ids, sim_states)
        self._elapsed[ids] = 0
        self.desired_goal[ids] = self.goals[skill]

    def mix_goals(self, ids: Array, weights: Array) -> None:
        """See `Environment`."""
        self.desired_goal[ids] = weights @ self.goals

    def observe(self) -> Array:
        """See `Environment`."""
        self._seen = self._position.astype(np.float32)
        if self._noise is not None:
            self._seen += (self._noise * self._chance.normal("noise", (self.num_envs, 2), np.arange(self.num_envs))).astype(
                np.float32
            )
        return self._seen

    def privileged(self) -> Array:
        """See `Environment`."""
        return np.zeros((self.num_envs, 0), dtype=np.float32)

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """See `Environment`: only the mean gain of the moves and the position noise apply."""
        self._gain = parameters.get("gain", np.ones((self.num_envs, 1))).mean(axis=1, keepdims=True)
        noise = parameters.get("position_noise")
        self._noise, self._chance = None if noise is None else noise[:, None], Chance(rng)

    def step(self, action: Array) -> Step:
        """See `Environment`."""
        action = np.clip(action, -1.0, 1.0)
        wanted = self._position + self._step_limit * self._gain * action
        np.clip(wanted, -self._bound, self._bound, out=self._position)
        held_back = (self._position - wanted) / np.maximum(self._gain, SMALLEST)
        self.applied = self._step_limit * action + held_back
        self._elapsed += 1
        reward = -np.linalg.norm(self._position - self.desired_goal[:, :2], axis=1)
        failed = np.zeros(self.num_envs, dtype=bool)
        return Step(self.observe(), reward, failed, self._elapsed >= self.horizon, {"distance": reward.copy()})

    def estimate_state(self) -> StateEstimate:
        """See `Environment`."""
        seen = self._seen.astype(float)
        return StateEstimate(seen, np.pad(seen, ((0, 0), (0, 1))), np.zeros((self.num_envs, 2)))

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """See `Environment`; a point has no resting offset."""
        self.restore(ids, np.clip(state, -self._bound, self._bound))

    def set_active(self, ids: Array | None) -> None:
        """See `Environment`; points cost nothing."""

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        return np.concatenate([self._position, np.zeros((self.num_envs, 1))], axis=1)

    def keypoints(self) -> Array:
        """See `Environment`."""
        return self.achieved_goal()[:, None]

    def save(self, ids: Array) -> Array:
        """See `Environment`."""
        sim_states: Array = self._position[ids]
        return sim_states

    def restore(self, ids: Array, sim_states: Array) -> None:
        """See `Environment`."""
        self._position[ids] = sim_states

    def violations(self) -> Array:
        """See `Environment`; a point has no limits."""
        return np.zeros((self.num_envs, 0), dtype=bool)

    def recorded_state(self) -> dict[str, Array]:
        """See `Environment`."""
        return {"position": self._position.copy()}
