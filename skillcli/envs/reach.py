"""The reach task: the Sawyer's gripper goes to a point in space, driven by joint increments."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from skillcli.envs import sawyer
from skillcli.envs.arms import Arms
from skillcli.envs.environment import Array, Step
from skillcli.recipe import ReachTask


def reach_spec(task: ReachTask, delay: bool = False) -> mujoco.MjSpec:
    """The scene of the task: the arm behind its table."""
    return sawyer.arm_spec(task.timestep, delay)


class ReachEnvironment:
    """N Sawyer arms.

    Observation (10): seven joint angles, rad, and the gripper's position, m. Action (7): joint increments in units of
    the action limit. Reward: minus the distance of gripper and goal, m.
    """

    observation_size = 10
    action_size = 7

    def __init__(self, task: ReachTask, num: int, threads: int = 0, delay: bool = False) -> None:
        self.num, self.horizon, self.tolerance = num, task.horizon, task.tolerance
        self.control_period = task.control_period
        substeps = round(task.control_period / task.timestep)
        self.arms = Arms(reach_spec(task, delay).compile(), num, substeps, task.action_limit, threads)
        self.goals = np.array(task.goals)
        self.target = np.zeros((num, 3))
        self.start = np.tile(np.array(task.start), (num, 1))  # (N, 7) rad; a transfer domain may move it
        self.applied = np.zeros((num, 7))
        self._elapsed = np.zeros(num, dtype=np.int64)
        self._noise: dict[str, Array] | None = None  # sensor noise of a transfer domain, (N, 1) each
        self._rng = np.random.default_rng(0)
        self.reset(np.arange(num), np.zeros(num, dtype=np.int64))

    def reset(self, ids: Array, skill: Array) -> None:
        """See `Environment`."""
        self.arms.place(ids, self.start[ids])
        self._begin_clock(ids, skill)

    def begin(self, ids: Array, rows: Array, skill: Array) -> None:
        """See `Environment`."""
        self.arms.restore(ids, rows)
        self._begin_clock(ids, skill)

    def _begin_clock(self, ids: Array, skill: Array) -> None:
        self._elapsed[ids] = 0
        self.target[ids] = self.goals[skill]

    def observe(self) -> Array:
        """See `Environment`."""
        observation = np.empty((self.num, 10), dtype=np.float32)
        observation[:, :7] = self.arms.joint_position
        observation[:, 7:] = self.arms.gripper_position
        if self._noise is not None:
            observation[:, :7] += self._noise["joint"] * self._rng.standard_normal((self.num, 7))
            observation[:, 7:] += self._noise["position"] * self._rng.standard_normal((self.num, 3))
        return observation

    def perturb(self, parameters: Mapping[str, Array], rng: np.random.Generator) -> None:
        """Turn every simulation into a robot of its own; see `skillcli.envs.domains.PARAMETERS`.

        Args:
            parameters: (N,) or (N, 7) by name.
            rng: of the sensor noise.
        """
        self.arms.perturb(parameters)
        self.start += parameters.get("start_offset", 0.0)
        none = np.zeros(self.num)
        joint, position = parameters.get("joint_noise", none), parameters.get("position_noise", none)
        self._noise, self._rng = {"joint": joint[:, None], "position": position[:, None]}, rng

    def step(self, action: Array) -> Step:
        """See `Environment`."""
        self.applied = self.arms.move(self.arms.action_limit * action)
        self._elapsed += 1
        broken = self.arms.unstable()
        if broken.any():  # a failed episode ends in a clear state, at the start, and never in NaN
            self.arms.place(np.flatnonzero(broken), self.start[broken])
        gap = self.arms.gripper_position - self.target
        reward = -np.sqrt(np.einsum("ij,ij->i", gap, gap))
        return Step(self.observe(), reward, broken, self._elapsed >= self.horizon)

    def judged(self) -> Array:
        """See `Environment`."""
        return self.arms.gripper_position.copy()

    def save(self, ids: Array) -> Array:
        """See `Environment`."""
        return self.arms.save(ids)

    def restore(self, ids: Array, rows: Array) -> None:
        """See `Environment`."""
        self.arms.restore(ids, rows)

    def snapshot(self) -> dict[str, Array]:
        """See `Environment`."""
        return {
            "joint_position": self.arms.joint_position,
            "gripper_position": self.arms.gripper_position.copy(),
        }
