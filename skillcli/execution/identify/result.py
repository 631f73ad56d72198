"""What an identification found: parameters with intervals, and how well they predict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skillcli.trajectories import Array


@dataclass(frozen=True)
class Estimate:
    """One parameter: its value, and the ends of its 95 % interval; (J,), (3,) or () each.

    Attributes:
        value: likeliest.
        low: lower end.
        high: upper end.
        told: whether the log says more than was believed before, of any of the values.
    """

    value: Array
    low: Array
    high: Array
    told: bool = True

    @staticmethod
    def of(value: Any, low: Any, high: Any, told: bool = True) -> Estimate:
        """Make an estimate from numbers or arrays."""
        return Estimate(np.asarray(value, dtype=float), np.asarray(low, dtype=float), np.asarray(high, dtype=float), told)

    def json(self) -> dict[str, Any]:
        """Return lists or numbers."""
        return {"value": self.value.tolist(), "low": self.low.tolist(), "high": self.high.tolist()}


@dataclass(frozen=True)
class Errors:
    """Root mean square of the predicted less the measured joint angles over held-out parts, rad.

    Attributes:
        nominal: of the simulation as it is, sent the same commands.
        fitted: of the fitted one.
        unmoved: of an arm that stays where it is.
    """

    nominal: float
    fitted: float
    unmoved: float

    def json(self) -> dict[str, float]:
        """Return the numbers by the names that a command prints."""
        return {"nominal_rad": self.nominal, "fitted_rad": self.fitted, "unmoved_rad": self.unmoved}


@dataclass(frozen=True)
class Identified:
    """What a log tells about an arm.

    Attributes:
        parameters: by name; those of a domain, and `tool_offset`.
        meaning: of the commands, in words.
        one_step: errors over one control step.
        half_second: errors over half a second.
        heldout_steps: control steps that the fit did not see.
        heldout: how they were chosen, in words.
        kept: whether the fit predicts them better than the nominal simulation; if not, `parameters` are the nominal ones.
        notes: what else is worth saying, one line each.
    """

    parameters: dict[str, Estimate]
    meaning: str
    one_step: Errors
    half_second: Errors
    heldout_steps: int
    heldout: str
    kept: bool
    notes: tuple[str, ...] = field(default=())

    def json(self) -> dict[str, Any]:
        """Return what a command prints."""
        overall = self.half_second
        return {
            "parameters": {name: estimate.json() for name, estimate in self.parameters.items()},
            "prediction": {
                "nominal_rad": overall.nominal,
                "fitted_rad": overall.fitted,
                "heldout_steps": self.heldout_steps,
                "measure": "root mean square over joints and half-second windows",
                "one_step": self.one_step.json(),
                "half_second": overall.json(),
            },
            "command_meaning": self.meaning,
            "heldout": self.heldout,
            "kept": self.kept,
            "notes": list(self.notes),
        }
