"""The parameters of the simulated robot that can be turned while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from skillcli.config.randomization import IDENTITY, PARAMETERS, PER_JOINT
from skillcli.errors import UsageError
from skillcli.trajectories import Array


class Knob(NamedTuple):
    """One parameter of `skillcli.config.randomization`, and how far it can be turned."""

    name: str
    label: str
    low: float
    high: float
    step: float


# From nothing to what the hardest domains draw: real-like, peng and dactyl stay within.
_ARM = (
    Knob("latency", "latency, s", 0.0, 0.15, 0.005),
    Knob("contact_friction", "friction of table and box, factor", 0.1, 3.0, 0.05),
    Knob("joint_friction", "friction of the joints, factor", 0.0, 5.0, 0.05),
)
_GAIN = Knob("gain", "gain of the servos, factor", 0.2, 2.0, 0.05)


def knobs_for(uses_robot: bool) -> tuple[Knob, ...]:
    """Return the knobs that have an effect; a task without an arm has only the gain of its moves."""
    return (*_ARM, _GAIN) if uses_robot else (_GAIN,)


def nominal(knobs: tuple[Knob, ...]) -> dict[str, float]:
    """Return the values that change nothing."""
    return {knob.name: IDENTITY[knob.name] for knob in knobs}


def checked(knobs: tuple[Knob, ...], name: str, value: float) -> float:
    """Return a value within the limits of its knob.

    Raises:
        UsageError: there is no such knob, or the value is not a number.
    """
    named = {knob.name: knob for knob in knobs}
    if name not in named:
        raise UsageError(f"{name!r} cannot be changed here", f"these can: {', '.join(named)}")
    if not np.isfinite(value):
        raise UsageError(f"{name} must be a number, got {value}", f"{named[name].low:g} to {named[name].high:g}")
    return float(np.clip(value, named[name].low, named[name].high))


def parameters(values: Mapping[str, float], joints: int) -> dict[str, Array]:
    """Return the values as one simulated robot takes them, (1,) or (1, joints) by name."""
    return {name: np.full((1, joints) if PARAMETERS[name].size == PER_JOINT else (1,), value) for name, value in values.items()}
