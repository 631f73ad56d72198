"""Sensors that measure the true state with latency, offset, drift and noise.

Their state belongs to the robot and its episode, not to the simulator: saved states do not contain it. After a simulation
is put into a state, a late sensor reads as if it had always been there; its drift continues until the next episode.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skillcli.simulation.chance import Chance, Rng
from skillcli.trajectories import Array

USED = (
    "observation_latency", "joint_noise", "position_noise", "joint_drift", "position_drift", "joint_offset", "position_offset",
)  # fmt: skip


def needed(parameters: Mapping[str, Array]) -> bool:
    """Return whether any parameter asks for imperfect sensors."""
    return any(name in parameters and np.any(parameters[name]) for name in USED)


class Sensors:
    """Measurements of N simulations: J joint angles, rad, and one position, m, together (N, J+3).

    True states may have more columns; these are as late, and otherwise exact.

    A late reading is interpolated linearly between two control steps. Drift is an autoregressive process of first order, the
    Ornstein-Uhlenbeck process at the times of the control steps: its standard deviation is constant, and its correlation
    after a time t is exp(-t / drift_time).

    Args:
        parameters: (N,) or (N, n) by name, see `skillcli.config.randomization.PARAMETERS`.
        num_envs: simulations.
        period: between two control steps, s.
        rng: of all noise, one for all or one each.
        joints: J.
        columns: of the true states.
    """

    def __init__(
        self, parameters: Mapping[str, Array], num_envs: int, period: float, rng: Rng, joints: int, columns: int = 0
    ) -> None:
        self._measured = joints + 3  # columns with offset, drift and noise
        self._chance, self._each = Chance(rng), np.arange(num_envs)
        self._white = _pair(parameters, num_envs, joints, "joint_noise", "position_noise")
        self._spread = _pair(parameters, num_envs, joints, "joint_drift", "position_drift")
        self._offset = np.zeros((num_envs, self._measured))
        self._offset[:, :joints] = parameters.get("joint_offset", 0.0)
        self._offset[:, joints:] = parameters.get("position_offset", 0.0)
        time = parameters.get("drift_time", np.zeros(num_envs))[:, None]
        self._keeps = np.exp(-period / np.maximum(time, 1e-9))  # decay of the drift in one step
        self._drift = np.zeros((num_envs, self._measured))
        age = parameters.get("observation_latency", np.zeros(num_envs)) / period  # in control steps
        self._late = np.floor(age).astype(np.int64)
        self._between = (age - self._late)[:, None]
        self._past = np.zeros((int(self._late.max(initial=0)) + 2, num_envs, columns or self._measured))  # the newest first

    def reset(self, ids: Array, true: Array) -> None:
        """Begin new episodes of these simulations in true states (n, columns)."""
        self.settle(ids, true)
        if self._spread.any():
            self._drift[ids] = self._spread[ids] * self._chance.normal("drift", (len(ids), self._measured), ids)

    def settle(self, ids: Array, true: Array) -> None:
        """Set the history of these simulations as if they had always been in true states (n, columns)."""
        self._past[:, ids] = true

    def advance(self, true: Array) -> None:
        """Advance by one control step to true states (N, columns)."""
        self._past = np.roll(self._past, 1, axis=0)
        self._past[0] = true
        if self._spread.any():
            fresh = self._spread * self._chance.normal("drift", self._drift.shape, self._each)
            self._drift = self._keeps * self._drift + np.sqrt(1 - self._keeps**2) * fresh

    def read(self) -> Array:
        """Return the present measurements, (N, columns)."""
        newer, older = self._past[self._late, self._each], self._past[self._late + 1, self._each]
        measured: Array = newer + self._between * (older - newer)
        measured[:, : self._measured] += self._offset + self._drift
        if self._white.any():
            measured[:, : self._measured] += self._white * self._chance.normal("noise", self._white.shape, self._each)
        return measured

    def angle_error(self, arm: Array) -> Array:
        """Draw the white noise of an angle computed from two positions `arm` (N,) m apart, (N,) rad."""
        error: Array = self._white[:, -1] / arm * self._chance.normal("angle", arm.shape, self._each)
        return error


def _pair(parameters: Mapping[str, Array], num_envs: int, joints: int, joint: str, position: str) -> Array:
    """Return the standard deviations of the measurements, (N, J+3)."""
    spread = np.zeros((num_envs, joints + 3))
    for name, where in ((joint, slice(0, joints)), (position, slice(joints, None))):
        spread[:, where] = parameters.get(name, np.zeros(num_envs))[:, None]
    return spread
