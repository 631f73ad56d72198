"""Fit the zeros of the joints and the place of the tool to measured gripper positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from skillcli.execution.identify.knobs import CERTAIN
from skillcli.execution.log import Log
from skillcli.simulation.replay import ForwardKinematics
from skillcli.trajectories import Array

POSES = 300  # of a log, at most
ZERO_SPREAD = 0.02  # rad, of a joint's zero before anything is measured
TOOL_SPREAD = 0.3  # m, of the tool: a robot file may mount another one
LEAST_NOISE = 1e-4  # m
DIFFERENCE = 1e-5  # rad


@dataclass(frozen=True)
class ToolFit:
    """How the measured gripper stands to that of the robot file.

    Attributes:
        zero: (J,) rad, error of each joint's zero.
        zero_spread: (J,) rad, its standard deviation.
        tool: (3,) m, from the robot file's gripper to the measured one, in the axes of the gripper.
        tool_spread: (3,) m.
        noise: m, standard deviation of each coordinate of a measured position.
        median: m, median distance that is left.
    """

    zero: Array
    zero_spread: Array
    tool: Array
    tool_spread: Array
    noise: float
    median: float


def fit_tool(kinematics: ForwardKinematics, log: Log) -> ToolFit | None:
    """Fit zeros and tool by least squares; None if no gripper was measured."""
    if log.gripper_position is None:
        return None
    chosen = np.unique(np.linspace(0, len(log.stamps) - 1, POSES).round().astype(int))
    angles, measured = log.position[chosen], log.gripper_position[chosen]
    joints = log.joints

    def errors(x: Array) -> Array:
        place, axes = kinematics.frames(angles - x[:joints])
        off: Array = (place + axes @ x[joints:] - measured).ravel()
        return off

    spread = np.concatenate([np.full(joints, ZERO_SPREAD), np.full(3, TOOL_SPREAD)])
    noise, x = 0.003, np.zeros(joints + 3)
    for _ in range(3):  # the noise decides what the prior weighs, and is known only afterwards

        def weighed(y: Array, noise: float = noise) -> Array:
            return np.concatenate([errors(y * spread) / noise, y])

        found = least_squares(weighed, x / spread, diff_step=1e-4, max_nfev=20)
        x = found.x * spread
        noise = max(LEAST_NOISE, float(errors(x).std()))
    deviation = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))) * spread
    left = np.linalg.norm(errors(x).reshape(-1, 3), axis=1)
    return ToolFit(x[:joints], deviation[:joints], x[joints:], deviation[joints:], noise, float(np.median(left)))


def within(value: Array, spread: Array) -> tuple[Array, Array]:
    """Return both ends of the 95 % interval."""
    return value - CERTAIN * spread, value + CERTAIN * spread
