"""The base class of all arm tasks: N arms with a start, a clock, sensors, and parameters of their own."""

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
from skillcli.simulation.fingers import Fingers
from skillcli.simulation.safety import RANGE_TOLERANCE, STIFF_TABLE_TOLERANCE, Clearance
from skillcli.simulation.sensors import Sensors
from skillcli.simulation.settings import ArmTask

# Frames of observed terms.
BASE = "of the base: the robot stands at the origin, x towards the table, z up, the table top at z = 0"
JOINTS = "the arm's encoders; zero and direction of each joint are those of the robot's model"
LEAD = "commanded target less measured angle of each joint"

REMEMBERED = 3  # control steps of commands to keep for state estimation: the longest delay of an actuator


class ArmEnvironment:
    """N arms. A task defines further observations, the achieved goal, the reward and failure.

    Observation: J joint angles, rad, and one position, m; then further terms of the task; then, if the task asks for it, the
    difference between commanded and measured joint angles, rad, which shows commands that are delayed or not yet followed.
    Action (J): joint increments in units of the action limit; of a task that grasps (J+1), the last an increment of the width
    between the fingers, in units of `Fingers.MAX_LEAD`.

    Args:
        task: start, clock and limits.
        robot: the arm to simulate.
        goals: (K, 3) m.
        num_envs: simulations.
        threads: of the engine, 0 for all cores; results do not depend on it.
        delay: whether a domain may delay the actuators.
    """

    grasps = False  # whether the fingers move
    failure_reward = 0.0  # reward of the step that fails
    table_tolerance = STIFF_TABLE_TOLERANCE
    position_term = ObservationTerm("gripper_position", "m", 3, BASE)  # the position observed after the joints
    shown_terms: ClassVar[tuple[ObservationTerm, ...]] = ()  # further observations of a task
    privileged_terms: ClassVar[tuple[ObservationTerm, ...]] = ()  # observations of the value function only
    recorded: ClassVar[Mapping[str, int]] = {"gripper_position": 3}  # recorded fields and their sizes, besides the joints

    def __init__(self, task: ArmTask, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False) -> None:
        self.num_envs, self.horizon, self.tolerance, self.robot = num_envs, task.horizon, task.tolerance, robot
        self.control_period = self.sensor_period = task.control_period  # s; how often sensors advance, see `coast`
        self._observe_command = task.observe_command
        joints = robot.joint_count
        self.joints, self.action_size = joints, joints + self.grasps
        self.observation_size = sum(term.size for term in self.observation_terms(task, joints))
        self.privileged_size = sum(term.size for term in self.privileged_terms)
        self.shown_size = sum(term.size for term in self.shows(task))
        spec = self.scene(task, robot, delay)
        substeps = round(task.control_period / spec.option.timestep)
        hand = robot.graspers() if self.grasps else None
        self.arms = ArmBatch(spec.compile(), num_envs, substeps, task.action_limit, robot.names, threads, hand)
        self.goals = goals
        self.desired_goal = np.zeros((num_envs, 3))
        self.applied, self.unstable = np.zeros((num_envs, self.action_size)), np.zeros(num_envs, dtype=bool)
        self._start = np.array(start_of(task, robot))
        self._speed_limit = robot.speed_limit
        self._start_offset = np.zeros((num_envs, joints))  # rad
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._past: deque[tuple[Array, Array]] = deque(maxlen=REMEMBERED)  # measured joints and commanded targets, rad
        self._joint_offset: Array | None = None  # rad
        self._sensors: Sensors | None = None  # None: perfect sensors
        self._disturbance: Disturbance | None = None
        self._clearance: Clearance | None = None  # made when first needed
        self.set_up(task)
        self.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))

    @classmethod
    def scene(cls, task: ArmTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
        """Build the scene: the arm behind its table, and what a task adds."""
        return robot.arm_spec(start_of(task, robot), task.timestep, task.control_period, delay)

    def set_up(self, task: ArmTask) -> None:
        """Set up a task's own state before the first reset."""

    @classmethod
    def shows(cls, task: ArmTask) -> tuple[ObservationTerm, ...]:
        """Return the terms of `shown`."""
        return cls.shown_terms

    @classmethod
    def observation_terms(cls, task: ArmTask, joints: int) -> tuple[ObservationTerm, ...]:
        """Return the terms of the observation in order."""
        seen = (ObservationTerm("joint_position", "rad", joints, JOINTS), cls.position_term, *cls.shows(task))
        return (*seen, ObservationTerm("command_lead", "rad", joints, LEAD)) if task.observe_command else seen

    def position(self) -> Array:
        """Return the position observed after the joints, (N, 3) m."""
        raise NotImplementedError

    def shown(self) -> Array:
        """Return the task's further observations from the last measurement, (N, `shown_size`)."""
        raise NotImplementedError

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        raise NotImplementedError

    def keypoints(self) -> Array:
        """See `Environment`."""
        return self.achieved_goal()[:, None]

    def reward_terms(self) -> RewardTerms:
        """Return the weighted rewards and costs of the present state by name, (N,) each."""
        raise NotImplementedError

    @property
    def reward_names(self) -> tuple[str, ...]:
        """See `Environment`."""
        return tuple(signed(self.reward_terms()))

    def reward(self) -> Array:
        """Return the reward of the present state, (N,)."""
        return total_reward(self.reward_terms())

    def failed(self) -> Array:
        """Return which simulations have failed in this step, (N,) bool; for `step`, once."""
        return self.unstable.copy()

    def place_object(self, ids: Array) -> Array | None:
        """Return start poses (n, 7) of the objects of these simulations, None without objects."""
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
        """Return what perfect sensors would measure, (N, J+3); an arm computes its gripper position from its joint angles.

        A task may add columns that must be as late as these.
        """
        position = self.position()
        if self._joint_offset is not None:
            position = position + self.arms.reported_shift(self._joint_offset)
        return np.concatenate([self.arms.joint_position, position], axis=1)

    def mix_goals(self, ids: Array, weights: Array) -> None:
        """See `Environment`."""
        self.desired_goal[ids] = weights @ self.goals

    def observe(self) -> Array:
        """See `Environment`."""
        joints = self.joints
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
        start = np.broadcast_to(parameters.get("start_offset", 0.0), (self.num_envs, self.joints))
        offset = parameters.get("joint_offset")
        self._joint_offset = offset if offset is not None and offset.any() else None
        # The arm starts where its encoders show the start. Later an offset of the encoders has no effect on increments: the
        # servo closes its loop on the same encoder.
        self._start_offset = start if self._joint_offset is None else start - self._joint_offset
        self._sensors = self._disturbance = None
        if disturbance.needed(parameters):
            self._disturbance = Disturbance(parameters, self.num_envs, self.arms.substeps, self.control_period, rng)
        if sensors.needed(parameters):
            true = self._true()
            self._sensors = Sensors(parameters, self.num_envs, self.sensor_period, rng, self.joints, true.shape[1])
            self._sensors.reset(np.arange(self.num_envs), true)

    def step(self, action: Array) -> Step:
        """See `Environment`."""
        before = self._commanded()
        self.applied = self._apply(action)
        self._past.append((self._measured[:, : self.joints], before))
        self._elapsed += 1
        self.unstable = self.arms.unstable()
        failed = self.failed()
        if failed.any():  # a failed episode returns to the start, so that no state is ever NaN
            self._place(np.flatnonzero(failed))
        if self._sensors is not None:
            self._sensors.advance(self._true())
            if failed.any():
                self._sensors.reset(np.flatnonzero(failed), self._true()[failed])
        terms = self.reward_terms()
        reward = np.where(failed, self.failure_reward, total_reward(terms))
        return Step(self.observe(), reward, failed, self._elapsed >= self.horizon, signed(terms))

    @property
    def disturbance(self) -> Disturbance | None:
        """Return what draws late commands and external forces; None if there are none."""
        return self._disturbance

    def coast(self, substeps: int) -> None:
        """Advance by physics steps with the commands as they are, and the sensors by one `sensor_period`."""
        self.arms.coast(substeps)
        if self._sensors is not None:
            self._sensors.advance(self._true())

    def measure(self) -> tuple[Array, Array | None]:
        """Return joint angles (N, J) rad and object poses (N, 7), or None without one, as the sensors show them now."""
        self.observe()
        return self._measured[:, : self.joints].astype(float), self.object_seen()

    def set_active(self, ids: Array | None) -> None:
        """See `Environment`."""
        self.arms.active = ids

    def remember(self, again: bool = False) -> None:
        """Keep what is measured and commanded for `estimate_state`, before somebody else moves the arm on by a control step.

        Args:
            again: forget what was kept: an episode begins.
        """
        if again:
            self._past.clear()
        else:
            self._past.append((self._measured[:, : self.joints], self._commanded()))

    def estimate_state(self) -> StateEstimate:
        """See `Environment`: joint angles and velocities, the last commands, and the pose of the object."""
        steps = min(2, len(self._past))  # over one step the noise would dominate the velocity
        velocity = np.zeros((self.num_envs, self.joints))
        if steps:
            velocity[:] = (self._measured[:, : self.joints] - self._past[-steps][0]) / (steps * self.control_period)
        commands = [command for _, command in self._past]
        commands = [*commands, self._commanded()]
        commands = [commands[0]] * (REMEMBERED + 1 - len(commands)) + commands
        object_pose = self.object_seen()
        parts: list[Array] = [self._measured[:, : self.joints], velocity, *commands]
        if self.grasps:
            parts += [self.arms.fingers.width[:, None], self.arms.fingers.commanded[:, None]]
        if object_pose is not None:
            parts.append(object_pose)
        state = np.concatenate(parts, axis=1)
        return StateEstimate(state, self.estimate_achieved_goal(object_pose), self.estimate_tilt(object_pose))

    def object_seen(self) -> Array | None:
        """Return the pose of the object as a camera measures it, (N, J), None without one."""
        return None

    def estimate_achieved_goal(self, object_pose: Array | None) -> Array:
        """Return the estimated achieved goal, (N, 3) m."""
        return self._measured[:, self.joints :].astype(float)

    def estimate_tilt(self, object_pose: Array | None) -> Array:
        """Return the estimated tilt of the object, (N, 2), see `StateEstimate`."""
        return np.zeros((self.num_envs, 2))

    def room(self) -> Array:
        """Return the clearance between the middle of the finger and the object, (N,) m; infinite without one."""
        return np.full(self.num_envs, np.inf)

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """See `Environment`."""
        n = self.joints
        ends = np.cumsum([n, n, n * (REMEMBERED + 1), 2 * self.grasps])
        joints, velocity, commands, hand, pose = np.split(state, ends, axis=1)
        commands = commands.reshape(len(ids), REMEMBERED + 1, n)
        self.arms.set_state(
            ids, joints, velocity, commands, pose if pose.shape[1] else None, sag, hand if hand.shape[1] else None
        )

    def _commanded(self) -> Array:
        """Return the commands as the controller reads them, (N, J) rad: with the offset of the encoders."""
        if self._joint_offset is None:
            return self.arms.commanded.copy()
        shown: Array = self.arms.commanded + self._joint_offset
        return shown

    def _apply(self, action: Array) -> Array:
        """Apply actions (N, a) for a control step; return how far the commands moved, (N, a) rad, and m of the width."""
        if not self.grasps:
            return self._move(self.arms.action_limit * action)
        moved = self.arms.fingers.move(Fingers.MAX_LEAD * np.clip(action[:, -1], -1.0, 1.0))
        return np.column_stack([self._move(self.arms.action_limit * action[:, :-1]), moved])

    def _move(self, increment: Array) -> Array:
        if self._disturbance is None:
            return self.arms.step(increment)
        latency, forces = self._disturbance.latency(), self._disturbance.forces()
        if forces is None:
            return self.arms.step(increment, latency)
        self.arms.apply_external_force(*forces)
        applied = self.arms.step(increment, latency)
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
    """Return the joint angles at reset, (J,) rad: from the task, else from the robot's file for this task."""
    return task.start or robot.start(task.name)
