"""Random disturbances of a moving robot: late commands and external forces."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skillcli.simulation.chance import Chance, Rng
from skillcli.trajectories import Array


def needed(parameters: Mapping[str, Array]) -> bool:
    """Return whether any parameter asks for a disturbance."""
    return any(name in parameters and np.any(parameters[name]) for name in ("control_jitter", "arm_push", "object_push"))


class Disturbance:
    """Draws the latency of the command and the external forces for every control step of N simulations.

    External forces begin as a Poisson process and last one control period.

    Args:
        parameters: (N,) by name, see `skillcli.config.randomization.PARAMETERS`.
        num_envs: simulations.
        substeps: physics steps in a control step.
        period: of a control step, s.
        rng: one generator for all, or one each.
    """

    def __init__(self, parameters: Mapping[str, Array], num_envs: int, substeps: int, period: float, rng: Rng) -> None:
        none = np.zeros(num_envs)
        self._chance, self._each, self._period = Chance(rng), np.arange(num_envs), period
        jitter = np.minimum(parameters.get("control_jitter", none), period)
        self._latest = np.round(jitter / period * substeps).astype(np.int64)  # substeps
        self._likely = -np.expm1(-period * parameters.get("push_rate", none))  # probability of a force in a control step
        self._arm, self._object = parameters.get("arm_push", none), parameters.get("object_push", none)

    def latency(self) -> Array | None:
        """Draw after how many substeps each command takes effect, (N,); None if none is late."""
        if not self._latest.any():
            return None
        return self._chance.integers("latency", self._latest + 1)

    def forces(self) -> tuple[Array, Array] | None:
        """Draw forces on arm and box in this control step, (N, 3) N each; None if there are none."""
        if not self._likely.any():
            return None
        direction = self._chance.normal("forces", (2, len(self._each), 3), self._each, axis=1)
        direction[1, :, 2] = 0.0
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        acting = self._chance.uniform("forces", (2, len(self._each)), self._each, axis=1) < self._likely
        arm, box = direction * (acting * np.stack([self._arm, self._object]) / self._period)[..., None]
        return arm, box
