"""The parameters that a fit turns, and what is believed of each before a log is read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skillcli.config.randomization import IDENTITY, PARAMETERS
from skillcli.trajectories import Array

CERTAIN = 1.96  # standard deviations to either side that hold 95 %


class Prior(NamedTuple):
    """What is believed of a parameter: its nominal value, give or take."""

    spread: float  # standard deviation, of the logarithm for a factor
    factor: bool  # whether it is spread on a logarithmic scale


# Widths as of a robot known from its data sheet only; those of friction are wide, since nobody writes it down.
PRIORS = {
    "gain": Prior(0.35, True),
    "joint_damping": Prior(0.7, True),
    "joint_friction": Prior(0.7, True),
    "link_mass": Prior(0.25, True),
    "gravity_compensation": Prior(0.1, False),
    "command_response": Prior(1.2, True),  # the scale of an action is a matter of convention
}


class Knobs:
    """A vector of numbers, one for each value of some parameters, each with mean 0 and variance 1 before the fit.

    Args:
        names: of the parameters, of `PRIORS`.
        joints: of the arm, J.
    """

    def __init__(self, names: Sequence[str], joints: int) -> None:
        self.names = tuple(names)
        sizes = [PARAMETERS[name].size or joints for name in names]
        ends = np.cumsum([0, *sizes])
        self._where = {name: slice(int(a), int(b)) for name, a, b in zip(names, ends[:-1], ends[1:], strict=True)}
        self.count = int(ends[-1])

    def where(self, name: str) -> slice:
        """Return which of the numbers are those of a parameter."""
        return self._where[name]

    def parameters(self, x: Array) -> dict[str, Array]:
        """Return the parameters by name, (J,) or () each."""
        return {name: self.value(name, x[where]) for name, where in self._where.items()}

    def interval(self, name: str, x: Array, spread: Array) -> tuple[Array, Array, Array]:
        """Return value, and ends of the 95 % interval, of a parameter from means and standard deviations of all numbers."""
        where = self._where[name]
        off = CERTAIN * spread[where]
        return self.value(name, x[where]), self.value(name, x[where] - off), self.value(name, x[where] + off)

    @staticmethod
    def value(name: str, x: Array) -> Array:
        """Return the values of one parameter that these numbers stand for, within its bounds."""
        prior, neutral, bounds = PRIORS[name], IDENTITY[name], PARAMETERS[name]
        raw = neutral * np.exp(prior.spread * x) if prior.factor else neutral + prior.spread * x
        values: Array = np.clip(raw, bounds.low, bounds.high)
        return values[0] if bounds.size == 1 else values
