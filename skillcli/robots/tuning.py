"""Gains for an arm that is driven by motors, or by nothing: from the inertia of its links and a bandwidth, tested by a step."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from skillcli.robots.posture import joint_inertia, joint_ranges
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array

BANDWIDTHS = (5.0, 4.0, 3.0, 2.0)  # Hz, the stiffest first
POSTURES = 30  # over which the inertia is averaged
MOTOR_ACCELERATION = 250.0  # rad/s²: a geared motor brings itself to about that, so its inertia is its torque over this
LIGHTEST = 0.02  # kg·m², of a joint whose torque is not known
STEP, STEPS, PERIOD = 0.04, 5, 0.05  # rad, and how many such commands at 20 Hz
SETTLED_SECONDS = 0.6
OVERSHOOT, FINAL_ERROR = 0.15, 0.02  # largest of a good servo, as shares of the step


class Gains(NamedTuple):
    """Stiffness N·m/rad and damping N·m·s/rad of each joint."""

    kp: tuple[float, ...]
    kv: tuple[float, ...]


class Response(NamedTuple):
    """How a joint answers a step, as shares of the step."""

    overshoot: float
    error: float  # in the end

    @property
    def good(self) -> bool:
        """Whether a policy can be trained on such a servo."""
        return self.overshoot <= OVERSHOOT and self.error <= FINAL_ERROR


def propose_gains(model: mujoco.MjModel, joints: tuple[str, ...], torque: Array, bandwidth: float) -> Gains:
    """Critically damped servos: kp = I ω², kv = 2 I ω, with the mean inertia I that a joint has when the others stand still.

    Args:
        model: of the arm.
        joints: its hinges.
        torque: largest of each joint, (n,) N·m; infinite where it is not known.
        bandwidth: ω / 2π, Hz.
    """
    inertia = np.maximum(mean_inertia(model, joints), np.where(np.isfinite(torque), torque / MOTOR_ACCELERATION, LIGHTEST))
    omega = 2 * np.pi * bandwidth
    damping = model.dof_damping[[model.joint(name).dofadr[0] for name in joints]]
    kp = np.maximum(inertia * omega, damping / 2) * omega  # a joint that is damped more than critically is slow
    return Gains(_significant(kp), _significant(2 * inertia * omega))


def mean_inertia(model: mujoco.MjModel, joints: tuple[str, ...]) -> Array:
    """Inertia of each joint with the others locked, in the mean over random postures, (n,) kg·m²."""
    rng, data = np.random.default_rng(0), mujoco.MjData(model)
    qpos, ranges = [model.joint(name).qposadr[0] for name in joints], joint_ranges(model, joints, free=np.pi)
    total = np.zeros(len(joints))
    for _ in range(POSTURES):
        data.qpos[qpos] = rng.uniform(ranges[:, 0], ranges[:, 1])
        mujoco.mj_fwdPosition(model, data)
        total += np.diag(joint_inertia(model, data, joints))
    mean: Array = total / POSTURES
    return mean


def step_responses(robot: Robot, start: Array) -> list[Response]:
    """What each joint does when its command moves from the start (n,) rad by some steps of a policy, and then stays."""
    model, names = robot.model, robot.names
    qpos = [model.joint(name).qposadr[0] for name in names.joints]
    controls = [model.actuator_ctrladr[model.actuator(name).id] for name in names.servos]
    substeps = max(1, round(PERIOD / model.opt.timestep))
    found = []
    for joint in range(len(qpos)):
        data = mujoco.MjData(model)
        data.qpos[qpos], data.ctrl[controls] = start, start
        away = _away_from_limits(robot, joint, float(start[joint]))
        reached = []
        for control in range(STEPS + round(SETTLED_SECONDS / PERIOD)):
            data.ctrl[controls[joint]] = start[joint] + away * STEP * min(control + 1, STEPS)
            for _ in range(substeps):
                mujoco.mj_step(model, data)
                reached.append(away * float(data.qpos[qpos[joint]] - start[joint]) / (STEP * STEPS))
        track = np.array(reached)
        if not (np.isfinite(track).all() and np.abs(track).max() < 10):
            found.append(Response(np.inf, np.inf))
        else:
            found.append(Response(float(track.max() - 1), float(abs(track[-substeps:].mean() - 1))))
    return found


def _away_from_limits(robot: Robot, joint: int, angle: float) -> float:
    """The direction in which a joint has more room."""
    low, high = joint_ranges(robot.model, robot.names.joints)[joint]
    return 1.0 if high - angle >= angle - low else -1.0


def _significant(numbers: Array) -> tuple[float, ...]:
    """Rounded to three digits: more would say that they are known."""
    return tuple(float(f"{x:.3g}") for x in numbers)
