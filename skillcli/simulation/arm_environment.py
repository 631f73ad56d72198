"""What every task of an arm shares: N arms with a start, a clock, sensors and a robot of their own."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import ClassVar

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.simulation import disturbance, sensors
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.chance import Rng
from skillcli.simulation.disturbance import Disturbance
from skillcli.simulation.environment import Array, ObservationTerm, RewardTerms, StateEstimate, Step, signed, total_reward
from skillcli.simulation.safety import RANGE_TOLERANCE, STIFF_TABLE_TOLERANCE, Clearance
from skillcli.simulation.sensors import Sensors
from skillcli.simulation.settings import ArmTask

REMEMBERED = 3  # control steps of which commands are kept for a look: as far back as an actuator may be delayed


class ArmEnvironment:
    """N arms; a task says what is seen beside the joints, what is judged, what earns reward and what has failed.

    Observation: J joint angles, rad, and one position, m; then what else a task of its own shows; and, where the task says so,
    how far the commanded joint target leads the measured joints, rad, which tells commands that are delayed or not yet obeyed.
    Action (J): joint increments in units of the action limit.

    Args:
        task: start, clock and limits.
        robot: whose arm stands in the scene.
        goals: (K, 3) m.
        num_envs: simulations.
        threads: of the engine, 0 for all cores; results do not depend on it.
        delay: whether a domain may delay the actuators.
    """

    failure_reward = 0.0  # of the step that fails
    table_tolerance = STIFF_TABLE_TOLERANCE
    position_term = ObservationTerm("gripper_position", "m", 3)  # what stands beside the joints
    shown_terms: ClassVar[tuple[ObservationTerm, ...]] = ()  # what else a task shows
    privileged_terms: ClassVar[tuple[ObservationTerm, ...]] = ()  # what only a value function sees
    recorded: ClassVar[Mapping[str, int]] = {"gripper_position": 3}  # fields of a recording beside the joints, and their sizes

    def __init__(self, task: ArmTask, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False) -> None:
        self.num_envs, self.horizon, self.tolerance, self.robot = num_envs, task.horizon, task.tolerance, robot
        self.control_period = task.control_period
        self._observe_command = task.observe_command
        joints = robot.joint_count
        self.joints = self.action_size = joints
        self.observation_size = sum(term.size for term in self.observation_terms(task, joints))
        self.privileged_size = sum(term.size for term in self.privileged_terms)
        self.shown_size = sum(term.size for term in self.shows(task))
        spec = self.scene(task, robot, delay)
        substeps = round(task.control_period / spec.option.timestep)
        self.arms = ArmBatch(spec.compile(), num_envs, substeps, task.action_limit, robot.names, threads)
        self.goals = goals
        self.desired_goal = np.zeros((num_envs, 3))
        self.applied, self.unstable = np.zeros((num_envs, joints)), np.zeros(num_envs, dtype=bool)
        self._start = np.array(start_of(task, robot))
        self._speed_limit = robot.speed_limit
        self._start_offset = np.zeros((num_envs, joints))  # rad
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._past: deque[tuple[Array, Array]] = deque(maxlen=REMEMBERED)  # measured joints and commanded targets, rad
        self._joint_offset: Array | None = None  # rad
        self._sensors: Sensors | None = None  # None: everything is measured as it is
        self._disturbance: Disturbance | None = None
        self._clearance: Clearance | None = None  # made when it is first asked for
        self.set_up(task)
        self.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))

    @classmethod
    def scene(cls, task: ArmTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
        """The arm behind its table, and what a task adds."""
        return robot.arm_spec(start_of(task, robot), task.timestep, task.control_period, delay)

    def set_up(self, task: ArmTask) -> None:
        """Set what a task of its own keeps, before the first reset."""

    @classmethod
    def shows(cls, task: ArmTask) -> tuple[ObservationTerm, ...]:
        """What `shown` holds."""
        return cls.shown_terms

    @classmethod
    def observation_terms(cls, task: ArmTask, joints: int) -> tuple[ObservationTerm, ...]:
        """What the policy sees, in order."""
        seen = (ObservationTerm("joint_position", "rad", joints), cls.position_term, *cls.shows(task))
        return (*seen, ObservationTerm("command_lead", "rad", joints)) if task.observe_command else seen

    def position(self) -> Array:
        """What is observed beside the joints, (N, 3) m."""
        raise NotImplementedError

    def shown(self) -> Array:
        """What else is observed, from what was measured last; (N, `shown_size`)."""
        raise NotImplementedError

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        raise NotImplementedError

    def keypoints(self) -> Array:
        """See `Environment`."""
        return self.achieved_goal()[:, None]

    def reward_terms(self) -> RewardTerms:
        """What the present state earns and costs, by name, weighted, (N,) each."""
        raise NotImplementedError

    @property
    def reward_names(self) -> tuple[str, ...]:
        """See `Environment`."""
        return tuple(signed(self.reward_terms()))

    def reward(self) -> Array:
        """The task's reward for the present state, (N,)."""
        return total_reward(self.reward_terms())

    def failed(self) -> Array:
        """Which simulations have failed for good, (N,) bool."""
        return self.arms.unstable()

    def place_object(self, ids: Array) -> Array | None:
        """Poses (n, 7) that the objects of these simulations start at, None without objects."""
        return None

    def privileged(self) -> Array:
        """See `Environment`."""
        return np.zeros((self.num_envs, 0), dtype=np.float32)

    def reset(self, ids: Array, skill: Array) -> None:
        """See `Environment`."""
        self._past.clear()
        self._place(ids)
        self._begin(ids, skill)
        self._measured = self._true().astype(np.float32)

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """See `Environment`."""
        self.arms.restore(ids, sim_states)
        self._begin(ids, skill)

    def _place(self, ids: Array) -> None:
        self._put(ids, self.place_object(ids))

    def _put(self, ids: Array, object_pose: Array | None) -> None:
        self.arms.reset_to(ids, self._start + self._start_offset[ids], object_pose)

    def _begin(self, ids: Array, skill: Array) -> None:
        self._elapsed[ids] = 0
        self.desired_goal[ids] = self.goals[skill]
        if self._sensors is not None:
            self._sensors.reset(ids, self._true()[ids])

    def _true(self) -> Array:
        """What perfect sensors would report, (N, J+3); the arm computes its gripper position from its joint angles.

        A task may add columns that its look needs as late as these.
        """
        position = self.position()
        if self._joint_offset is not None:
            position = position + self.arms.reported_shift(self._joint_offset)
        return np.concatenate([self.arms.joint_position, position], axis=1)

    def observe(self) -> Array:
        """See `Environment`."""
        joints = self.action_size
        measured = joints + 3
        observation = np.empty((self.num_envs, self.observation_size), dtype=np.float32)
        if self._sensors is None:
            observation[:, :joints] = self.arms.joint_position
            observation[:, joints:measured] = self.position()
            self._measured = observation[:, :measured]
        else:
            self._measured = self._sensors.read().astype(np.float32)
            observation[:, :measured] = self._measured[:, :measured]
        if self.shown_size:
            observation[:, measured : measured + self.shown_size] = self.shown()
        if self._observe_command:
            observation[:, -joints:] = self._commanded() - observation[:, :joints]
        return observation

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """See `Environment`."""
        self.arms.randomize(parameters)
        start = np.broadcast_to(parameters.get("start_offset", 0.0), (self.num_envs, self.action_size))
        offset = parameters.get("joint_offset")
        self._joint_offset = offset if offset is not None and offset.any() else None
        # The arm goes where its encoders say the start is. From there on an offset that commands share with angles has no
        # effect on increments: the servo closes its loop on the same encoder.
        self._start_offset = start if self._joint_offset is None else start - self._joint_offset
        self._sensors = self._disturbance = None
        if disturbance.needed(parameters):
            self._disturbance = Disturbance(parameters, self.num_envs, self.arms.substeps, self.control_period, rng)
        if sensors.needed(parameters):
            true = self._true()
            self._sensors = Sensors(parameters, self.num_envs, self.control_period, rng, self.action_size, true.shape[1])
            self._sensors.reset(np.arange(self.num_envs), true)

    def step(self, action: Array) -> Step:
        """See `Environment`."""
        before = self._commanded()
        self.applied = self._move(self.arms.action_limit * action)
        self._past.append((self._measured[:, : self.action_size], before))
        self._elapsed += 1
        self.unstable, failed = self.arms.unstable(), self.failed()
        if failed.any():  # a failed episode ends in a clear state, at the start, and never in NaN
            self._place(np.flatnonzero(failed))
        if self._sensors is not None:
            self._sensors.advance(self._true())
            if failed.any():
                self._sensors.reset(np.flatnonzero(failed), self._true()[failed])
        terms = self.reward_terms()
        reward = np.where(failed, self.failure_reward, total_reward(terms))
        return Step(self.observe(), reward, failed, self._elapsed >= self.horizon, signed(terms))

    def set_active(self, ids: Array | None) -> None:
        """See `Environment`."""
        self.arms.active = ids

    def estimate_state(self) -> StateEstimate:
        """See `Environment`: joints and their velocities, the targets commanded of late, and the pose of the object."""
        steps = min(2, len(self._past))  # over one step the noise of the sensors would drown the velocity
        velocity = np.zeros((self.num_envs, self.action_size))
        if steps:
            velocity[:] = (self._measured[:, : self.action_size] - self._past[-steps][0]) / (steps * self.control_period)
        commands = [command for _, command in self._past]
        commands = [*commands, self._commanded()]
        commands = [commands[0]] * (REMEMBERED + 1 - len(commands)) + commands
        object_pose = self.object_seen()
        parts = (self._measured[:, : self.action_size], velocity, *commands, *(() if object_pose is None else (object_pose,)))
        state = np.concatenate(parts, axis=1)
        return StateEstimate(state, self.estimate_achieved_goal(object_pose), self.estimate_tilt(object_pose))

    def object_seen(self) -> Array | None:
        """Pose of the object as a camera shows it, (N, J), None without one."""
        return None

    def estimate_achieved_goal(self, object_pose: Array | None) -> Array:
        """Where the judged point seems to be, (N, 3) m."""
        return self._measured[:, self.action_size :].astype(float)

    def estimate_tilt(self, object_pose: Array | None) -> Array:
        """How the object seems to lean, (N, 2), see `StateEstimate`."""
        return np.zeros((self.num_envs, 2))

    def room(self) -> Array:
        """From the middles of the fingers to the objects, (N,) m; infinite without one."""
        return np.full(self.num_envs, np.inf)

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """See `Environment`."""
        n = self.action_size
        joints, velocity, rest = state[:, :n], state[:, n : 2 * n], state[:, 2 * n :]
        commands = rest[:, : n * (REMEMBERED + 1)].reshape(len(ids), REMEMBERED + 1, n)
        pose = rest[:, n * (REMEMBERED + 1) :]
        self.arms.set_state(ids, joints, velocity, commands, pose if pose.shape[1] else None, sag)

    def _commanded(self) -> Array:
        """Commanded targets as the controller shows them, (N, J) rad: they share the offset of the encoders."""
        if self._joint_offset is None:
            return self.arms.commanded.copy()
        shown: Array = self.arms.commanded + self._joint_offset
        return shown

    def _move(self, increment: Array) -> Array:
        if self._disturbance is None:
            return self.arms.step(increment)
        lateness, forces = self._disturbance.lateness(), self._disturbance.forces()
        if forces is None:
            return self.arms.step(increment, lateness)
        self.arms.apply_external_force(*forces)
        applied = self.arms.step(increment, lateness)
        self.arms.release()
        return applied

    def violations(self) -> Array:
        """See `Environment`."""
        if self._clearance is None:
            self._clearance = Clearance(self.arms.model)
        past = self.arms.past_range().max(axis=1) > RANGE_TOLERANCE
        fast = (np.abs(self.arms.joint_velocity) > self._speed_limit).any(axis=1)
        deep = self._clearance.depth(*self.arms.geom_frames()) > self.table_tolerance
        return np.stack([past, fast, deep], axis=1)

    def save(self, ids: Array) -> Array:
        """See `Environment`."""
        return self.arms.save(ids)

    def restore(self, ids: Array, sim_states: Array) -> None:
        """See `Environment`."""
        self.arms.restore(ids, sim_states)
        if self._sensors is not None:
            self._sensors.settle(ids, self._true()[ids])

    def recorded_state(self) -> dict[str, Array]:
        """See `Environment`."""
        return {
            "joint_position": self.arms.joint_position,
            "gripper_position": self.arms.gripper_position.copy(),
        }


def start_of(task: ArmTask, robot: Robot) -> tuple[float, ...]:
    """Joint vector at reset, (J,) rad: what the task says, else what the robot's file says for it."""
    return task.start or robot.start(task.name)
