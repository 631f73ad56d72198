"""Replay logged commands on simulated arms: many stretches of a log, on many parameters, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from skillcli.config.randomization import IDENTITY, PARAMETERS
from skillcli.robots.robot import Robot
from skillcli.robots.scene import GRIPPER
from skillcli.simulation.arms import ArmBatch
from skillcli.trajectories import Array

CAPACITY = 256  # simulations side by side: more would gain nothing
TIMESTEP = 0.005  # s, the physics of every arm task unless its recipe says otherwise
REMEMBERED = 4  # control steps of commands that a replay begins with: the longest latency, and the present one

ABSURD = 100.0  # rad: what is predicted where a simulation diverges

Parameters = Mapping[str, Array]  # by name, (J,) or () each


@dataclass(frozen=True)
class Start:
    """The states in which W replays begin, and the commands of each of their L control steps.

    Attributes:
        position: (W, J) rad.
        velocity: (W, J) rad/s.
        commands: (P or 1, W, `REMEMBERED`, J) rad, commanded angles before the first control step, the last one last; for each
            of P parameters, or for all.
        sent: (W, L, J) rad, of each control step: targets, or increments of the command.
    """

    position: Array
    velocity: Array
    commands: Array
    sent: Array


class Replay:
    """Simulated arms that repeat the commands of a log. They touch nothing and have no joint stops: a log tells neither.

    Args:
        robot: the arm.
        period: of a control step, s; a whole number of physics steps.
        action_limit: increments are clipped to it, rad.
        timestep: of the physics, s.
        threads: of the engine, 0 for all cores; results do not depend on it.
    """

    def __init__(self, robot: Robot, period: float, action_limit: float, timestep: float = TIMESTEP, threads: int = 0) -> None:
        spec = robot.arm_spec(robot.home, timestep, period, delay=True)
        model = spec.compile()
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        for joint, servo in zip(robot.names.joints, robot.names.servos, strict=True):
            model.jnt_limited[model.joint(joint).id] = 0
            model.actuator_ctrllimited[model.actuator(servo).id] = 0
        self.joints, self.period, self.action_limit = robot.joint_count, period, action_limit
        self.physics_step = float(model.opt.timestep)
        self._substeps = round(period / model.opt.timestep)
        self._arms = ArmBatch(model, CAPACITY, self._substeps, action_limit, robot.names, threads)

    def run(self, start: Start, parameters: Sequence[Parameters], increments: bool) -> Array:
        """Replay W stretches on each of P parameters, and return the joint angles after each step, (P, W, L, J) rad.

        Args:
            start: where they begin, and what is sent.
            parameters: P, by name; absent ones are nominal.
            increments: whether increments of the command are sent, as to every simulation; else targets, whatever the arm does.
        """
        windows, length = start.sent.shape[:2]
        angles = np.empty((len(parameters) * windows, length, self.joints))
        for first in range(0, len(angles), CAPACITY):
            number = np.arange(first, min(first + CAPACITY, len(angles)))
            which, window = number // windows, number % windows
            commands = start.commands[which if len(start.commands) > 1 else 0, window]
            part = Start(start.position[window], start.velocity[window], commands[None], start.sent[window])
            angles[number] = self._side_by_side(part, [parameters[p] for p in which], increments)
        return angles.reshape(len(parameters), windows, length, self.joints)

    def _side_by_side(self, start: Start, parameters: Sequence[Parameters], increments: bool) -> Array:
        count, length = start.sent.shape[:2]
        arms, ids = self._arms, np.arange(count)
        arms.randomize(self._columns(parameters))
        arms.active = ids
        arms.set_state(ids, start.position, start.velocity, start.commands[0])
        angles, sent = np.empty((count, length, self.joints)), np.zeros((CAPACITY, self.joints))
        for step in range(length):
            if increments:
                sent[:count] = start.sent[:, step]
                arms.step(sent)
            else:
                arms.commanded[:count] = start.sent[:, step]
                arms.coast(arms.substeps)
            angles[:, step] = arms.joint_position[:count]
        absurd = ~(np.abs(angles) < ABSURD).all(axis=(1, 2))  # true for NaN
        angles[absurd] = ABSURD
        return angles

    def _columns(self, parameters: Sequence[Parameters]) -> dict[str, Array]:
        """Return the parameters of each simulation, (CAPACITY,) or (CAPACITY, J) by name; the rest is nominal."""
        names = sorted({name for given in parameters for name in given})
        columns = {}
        for name in names:
            size = PARAMETERS[name].size or self.joints
            column = np.full((CAPACITY, size), IDENTITY[name])
            for row, given in enumerate(parameters):
                column[row] = given.get(name, IDENTITY[name])
            columns[name] = column[:, 0] if size == 1 else column
        return columns


class ForwardKinematics:
    """Where the gripper is, and how its body is turned, at joint angles.

    Args:
        robot: the arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._model, self._data = robot.model, mujoco.MjData(robot.model)
        self._qpos = [robot.model.joint(name).qposadr[0] for name in robot.names.joints]
        self._site = robot.model.site(GRIPPER).id

    def frames(self, angles: Array) -> tuple[Array, Array]:
        """Compute the gripper's position (T, 3) m and its axes (T, 3, 3) at joint angles (T, J) rad."""
        place, axes = np.empty((len(angles), 3)), np.empty((len(angles), 3, 3))
        for row, posture in enumerate(angles):
            self._data.qpos[self._qpos] = posture
            mujoco.mj_kinematics(self._model, self._data)
            place[row] = self._data.site_xpos[self._site]
            axes[row] = self._data.site_xmat[self._site].reshape(3, 3)
        return place, axes
