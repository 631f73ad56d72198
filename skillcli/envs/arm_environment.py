"""What every task of the Sawyer shares: N arms with a start, a clock, sensors and a robot of their own."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from skillcli.envs import sawyer
from skillcli.envs.arms import Arms
from skillcli.envs.environment import Array, Step
from skillcli.envs.robot import Robot
from skillcli.recipe import ArmTask


class ArmEnvironment:
    """N Sawyer arms; a task says what is seen beside the joints, what is judged, what earns reward and what has failed.

    Observation (10): seven joint angles, rad, and one position, m. Action (7): joint increments in units of the action
    limit.

    Args:
        task: start, clock and limits.
        spec: the scene.
        goals: (K, 3) m.
        num: simulations.
        threads: of the engine, 0 for all cores; results do not depend on it.
        robot: whose arm stands in the scene, the source's where there is none.
    """

    observation_size = 10
    action_size = 7
    privileged_size = 0
    failure_reward = 0.0  # of the step that fails

    def __init__(
        self, task: ArmTask, spec: mujoco.MjSpec, goals: Array, num: int, threads: int, robot: Robot | None = None
    ) -> None:
        self.num, self.horizon, self.tolerance = num, task.horizon, task.tolerance
        self.control_period = task.control_period
        substeps = round(task.control_period / spec.option.timestep)
        names = robot.names if robot else sawyer.NAMES
        self.arms = Arms(spec.compile(), num, substeps, task.action_limit, threads, names)
        self.goals = goals
        self.target = np.zeros((num, 3))
        self.applied = np.zeros((num, 7))
        self._start = np.array(robot.start(task) if robot else task.start)
        self._start_offset = np.zeros((num, 7))  # rad
        self._elapsed = np.zeros(num, dtype=np.int64)
        self._noise: dict[str, Array] | None = None  # of the sensors, (N, 1) each
        self._sensors = np.random.default_rng(0)
        self.reset(np.arange(num), np.zeros(num, dtype=np.int64))

    def position(self) -> Array:
        """What is observed beside the joints, (N, 3) m."""
        raise NotImplementedError

    def judged(self) -> Array:
        """See `Environment`."""
        raise NotImplementedError

    def landmarks(self) -> Array:
        """See `Environment`."""
        return self.judged()[:, None]

    def reward(self) -> Array:
        """The task's reward for the present state, (N,)."""
        raise NotImplementedError

    def failed(self) -> Array:
        """Which simulations have failed for good, (N,) bool."""
        return self.arms.unstable()

    def place_object(self, ids: Array) -> Array | None:
        """Poses (n, 7) that the objects of these simulations start at, None without objects."""
        return None

    def privileged(self) -> Array:
        """See `Environment`."""
        return np.zeros((self.num, 0), dtype=np.float32)

    def reset(self, ids: Array, skill: Array) -> None:
        """See `Environment`."""
        self._place(ids)
        self._begin_clock(ids, skill)

    def begin(self, ids: Array, rows: Array, skill: Array) -> None:
        """See `Environment`."""
        self.arms.restore(ids, rows)
        self._begin_clock(ids, skill)

    def _place(self, ids: Array) -> None:
        self.arms.place(ids, self._start + self._start_offset[ids], self.place_object(ids))

    def _begin_clock(self, ids: Array, skill: Array) -> None:
        self._elapsed[ids] = 0
        self.target[ids] = self.goals[skill]

    def observe(self) -> Array:
        """See `Environment`."""
        observation = np.empty((self.num, 10), dtype=np.float32)
        observation[:, :7] = self.arms.joint_position
        observation[:, 7:] = self.position()
        if self._noise is not None:
            observation[:, :7] += self._noise["joint"] * self._sensors.standard_normal((self.num, 7))
            observation[:, 7:] += self._noise["position"] * self._sensors.standard_normal((self.num, 3))
        return observation

    def perturb(self, parameters: Mapping[str, Array], rng: np.random.Generator) -> None:
        """See `Environment`."""
        self.arms.perturb(parameters)
        none = np.zeros(self.num)
        self._start_offset = np.broadcast_to(parameters.get("start_offset", 0.0), (self.num, 7))
        joint, position = parameters.get("joint_noise", none), parameters.get("position_noise", none)
        self._noise, self._sensors = {"joint": joint[:, None], "position": position[:, None]}, rng

    def step(self, action: Array) -> Step:
        """See `Environment`."""
        self.applied = self.arms.move(self.arms.action_limit * action)
        self._elapsed += 1
        failed = self.failed()
        if failed.any():  # a failed episode ends in a clear state, at the start, and never in NaN
            self._place(np.flatnonzero(failed))
        reward = np.where(failed, self.failure_reward, self.reward())
        return Step(self.observe(), reward, failed, self._elapsed >= self.horizon)

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
