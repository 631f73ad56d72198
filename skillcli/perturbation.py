"""What may differ from robot to robot and from episode to episode, and the ranges it is drawn from.

Training draws from such ranges to become robust, transfer draws from them to judge; both read and write them alike. In TOML:

    contact_friction = { uniform = [0.6, 1.4] }
    joint_damping = { log_uniform = [0.5, 2.0] }
    latency = { one_of = [0.0, 0.05] }
    joint_noise = 0.005
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator

from skillcli.trajectories import Array

# What may be changed: (values per episode, unit, meaning). Factors multiply the model's own value.
PARAMETERS: dict[str, tuple[int, str, str]] = {
    "link_mass": (7, "factor", "mass and inertia of the link behind each joint; the controller still knows the true weight"),
    "gravity_compensation": (1, "factor", "share of the arm's weight that the controller compensates"),
    "object_mass": (1, "factor", "mass and inertia of the box"),
    "joint_damping": (7, "factor", "viscous damping of each joint"),
    "joint_friction": (7, "factor", "dry friction of each joint"),
    "gain": (7, "factor", "stiffness of each servo, its damping with it"),
    "contact_friction": (1, "factor", "sliding friction of table and box"),
    "table_height": (1, "m", "offset of the table top"),
    "latency": (1, "s", "delay between a command and its effect, at most 0.155 s"),
    "joint_noise": (1, "rad", "standard deviation of white noise on measured joint angles"),
    "position_noise": (1, "m", "standard deviation of white noise on measured positions"),
    "start_offset": (7, "rad", "offset of each joint from the start pose"),
    "object_offset": (2, "m", "offset of the box from its nominal start, x and y"),
}
RANGE_KEYS = {"uniform", "log_uniform", "one_of", "kind", "values"}  # how a range is written, and stored
NEUTRAL = {name: 1.0 if unit == "factor" else 0.0 for name, (_, unit, _) in PARAMETERS.items()}


class Range(BaseModel):
    """Where values are drawn from."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["uniform", "log_uniform", "one_of"]
    values: tuple[float, ...]

    @model_validator(mode="before")
    @classmethod
    def _short(cls, given: Any) -> Any:
        if isinstance(given, int | float) and not isinstance(given, bool):
            return {"kind": "one_of", "values": (given,)}
        if isinstance(given, Mapping) and len(given) == 1 and next(iter(given)) in ("uniform", "log_uniform", "one_of"):
            kind, values = next(iter(given.items()))
            return {"kind": kind, "values": values}
        if (isinstance(given, Mapping) and set(given) == {"kind", "values"}) or isinstance(given, Range):
            return given
        raise ValueError("expected a number, or one of {uniform = [low, high]}, {log_uniform = [low, high]}, {one_of = [...]}")

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.values:
            raise ValueError("no values to choose from")
        if self.kind != "one_of" and (len(self.values) != 2 or self.values[0] > self.values[1]):
            raise ValueError(f"{self.kind} takes [low, high] with low <= high, got {list(self.values)}")
        if self.kind == "log_uniform" and self.values[0] <= 0:
            raise ValueError(f"log_uniform needs positive bounds, got {list(self.values)}")
        return self

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Values of the given shape."""
        if self.kind == "one_of":
            drawn: Array = rng.choice(np.array(self.values), shape)
            return drawn
        low, high = self.values
        if self.kind == "uniform":
            return rng.uniform(low, high, shape)
        logarithm: Array = rng.uniform(np.log(low), np.log(high), shape)
        return np.exp(logarithm)

    def quantile(self, share: Array) -> Array:
        """The values below which these shares, in [0, 1), of all draws lie; of a choice, that share of the list."""
        if self.kind == "one_of":
            chosen: Array = np.array(self.values)[(share * len(self.values)).astype(int)]
            return chosen
        low, high = self.values
        if self.kind == "uniform":
            return low + share * (high - low)
        logarithm: Array = np.log(low) + share * (np.log(high) - np.log(low))
        return np.exp(logarithm)

    def __str__(self) -> str:
        """As a person reads it."""
        if self.kind != "one_of":
            return f"{self.values[0]:g} .. {self.values[1]:g}" + (" (log)" if self.kind == "log_uniform" else "")
        return " or ".join(f"{value:g}" for value in self.values)


def uniform(low: float, high: float) -> Range:
    """Equally likely between low and high."""
    return Range(kind="uniform", values=(low, high))


def log_uniform(low: float, high: float) -> Range:
    """Equally likely per octave between low and high, both positive."""
    return Range(kind="log_uniform", values=(low, high))


def one_of(*values: float) -> Range:
    """One of these values."""
    return Range(kind="one_of", values=values)


def _known(ranges: dict[str, Range]) -> dict[str, Range]:
    unknown = sorted(set(ranges) - set(PARAMETERS))
    if unknown:
        raise ValueError(f"no parameter {unknown[0]!r}; parameters: {', '.join(PARAMETERS)}")
    for name, values in ranges.items():
        low = min(values.values)
        if low < 0 and name not in ("table_height", "start_offset", "object_offset"):
            raise ValueError(f"{name} must not be negative, got {low:g}")
    if "latency" in ranges and max(ranges["latency"].values) > MAX_LATENCY:
        raise ValueError(f"latency must be at most {MAX_LATENCY} s")
    return ranges


MAX_LATENCY = 0.155  # s: how far back the model's actuators remember their commands

Ranges = Annotated[dict[str, Range], AfterValidator(_known)]


def sample(ranges: Mapping[str, Range], episodes: int, rng: np.random.Generator) -> dict[str, Array]:
    """Draw parameters for each episode, (E,) or (E, n) by name; see `PARAMETERS`."""
    drawn = {}
    for name, values in sorted(ranges.items()):
        size = PARAMETERS[name][0]
        drawn[name] = values.draw(rng, (episodes,) if size == 1 else (episodes, size))
    return drawn


def fill(ranges: Mapping[str, Range], count: int, rng: np.random.Generator) -> dict[str, Array]:
    """Like `sample`, but spread out: every parameter takes one value out of each of `count` equal shares of its range.

    Latin hypercube sampling (McKay, Beckman and Conover 1979): a few robots show what many would.
    """
    filled = {}
    for name, values in sorted(ranges.items()):
        size = PARAMETERS[name][0]
        order = np.argsort(rng.random((count, size)), axis=0)
        share = (order + rng.random((count, size))) / max(1, count)
        drawn = values.quantile(share)
        filled[name] = drawn[:, 0] if size == 1 else drawn
    return filled
