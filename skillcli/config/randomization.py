"""Parameters that may differ between robots and episodes, and the distributions they are drawn from.

Training draws from such distributions to become robust, transfer draws from them to evaluate. In TOML:

    contact_friction = { uniform = [0.6, 1.4] }
    joint_damping = { log_uniform = [0.5, 2.0] }
    latency = { one_of = [0.0, 0.05] }
    joint_noise = 0.005
    joint_offset = { values = [0.01, 0, 0, -0.02, 0, 0, 0] }
    gain = { low = [0.8, 0.9, 0.7, 0.9, 0.9, 0.6, 0.8], high = [0.9, 1.1, 1.1, 1.0, 1.2, 0.9, 1.3] }
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Strict, model_validator

from skillcli.config.base import Section, value
from skillcli.errors import UsageError
from skillcli.trajectories import Array

PER_JOINT = 0


class Parameter(NamedTuple):
    """One parameter: the number of its values in an episode, its unit, its meaning, and the bounds of valid values."""

    size: int  # `PER_JOINT`: one for each joint of the arm
    unit: str
    meaning: str
    low: float
    high: float


MAX_LATENCY = 0.155  # s: length of the command history in the model's actuators

# All parameters. Factors multiply the model's own value: 1 changes nothing. All others are added: 0 changes nothing.
PARAMETERS: dict[str, Parameter] = {
    "link_mass": Parameter(
        PER_JOINT,
        "factor",
        "mass and inertia of the link behind each joint; the controller still knows the true weight",
        0.01,
        100,
    ),
    "link_inertia": Parameter(
        PER_JOINT, "factor", "rotational inertia of the link behind each joint, its mass unchanged", 0.01, 100
    ),
    "armature": Parameter(PER_JOINT, "factor", "inertia of each joint's motor, as felt behind its gear", 0.01, 100),
    "gravity_compensation": Parameter(1, "factor", "share of the arm's weight that the controller compensates", 0, 3),
    "object_mass": Parameter(1, "factor", "mass and inertia of the box", 0.01, 100),
    "object_size": Parameter(1, "factor", "edges of the box, its mass unchanged", 0.25, 4),
    "joint_damping": Parameter(PER_JOINT, "factor", "viscous damping of each joint", 0, 1000),
    "joint_friction": Parameter(PER_JOINT, "factor", "dry friction of each joint", 0, 1000),
    "gain": Parameter(PER_JOINT, "factor", "stiffness of each servo, its damping with it", 0, 1000),
    "command_response": Parameter(
        PER_JOINT, "factor", "share of each commanded increment, after clipping, by which the command moves", 0, 10
    ),
    "command_restart": Parameter(
        1, "share", "0: increments add to the command, 1: to the joint angle as it is, as controllers do that forget", 0, 1
    ),
    "contact_friction": Parameter(1, "factor", "sliding friction of table, box and finger", 0, 100),
    "table_height": Parameter(1, "m", "offset of the table top", -0.2, 0.2),
    "table_tilt": Parameter(2, "rad", "rotation of the table about the middle of its top, about x and y", -0.2, 0.2),
    "latency": Parameter(1, "s", f"delay between a command and its effect, at most {MAX_LATENCY} s", 0, MAX_LATENCY),
    "control_jitter": Parameter(
        1, "s", "each command comes late by a random time up to this, on top of latency; at most one control period", 0, 0.2
    ),
    "observation_latency": Parameter(1, "s", "age of what the sensors report", 0, 0.5),
    "joint_noise": Parameter(1, "rad", "standard deviation of white noise on measured joint angles", 0, 1),
    "position_noise": Parameter(1, "m", "standard deviation of white noise on measured positions", 0, 1),
    "joint_drift": Parameter(1, "rad", "standard deviation of slow noise on measured joint angles, see drift_time", 0, 1),
    "position_drift": Parameter(1, "m", "standard deviation of slow noise on measured positions, see drift_time", 0, 1),
    "drift_time": Parameter(1, "s", "time over which slow noise forgets: its correlation falls to 1/e", 0, 3600),
    "joint_offset": Parameter(
        PER_JOINT,
        "rad",
        "error of each joint's zero: angles, commands and the gripper position computed from them alike",
        -0.5,
        0.5,
    ),
    "position_offset": Parameter(3, "m", "constant error of measured positions, as of a camera: x, y and z", -0.5, 0.5),
    "push_rate": Parameter(1, "1/s", "how often something knocks against arm and box", 0, 20),
    "arm_push": Parameter(1, "N s", "impulse of a knock on the last link, in any direction", 0, 50),
    "object_push": Parameter(1, "N s", "impulse of a knock on the box, in any horizontal direction", 0, 10),
    "start_offset": Parameter(PER_JOINT, "rad", "offset of each joint from the start pose", -3.2, 3.2),
    "object_offset": Parameter(
        2, "m", "offset of the box from its nominal start, x and y; set beside an arm that it would stand in", -1, 1
    ),
    "object_yaw": Parameter(1, "rad", "rotation of a block about the vertical, at its start", -3.2, 3.2),
    "start_progress": Parameter(
        1,
        "share",
        "how far on episodes begin where a hand grasps: at 0 where their skill begins, at 1 nearly at its end",
        0,
        1,
    ),
}
# Parameters without effect unless another one is set.
NEEDS = {
    "joint_drift": ("drift_time",),
    "position_drift": ("drift_time",),
    "drift_time": ("joint_drift", "position_drift"),
    "arm_push": ("push_rate",),
    "object_push": ("push_rate",),
    "push_rate": ("arm_push", "object_push"),
}
STARTS = ("start_offset", "object_offset", "object_yaw", "start_progress")  # of where an episode begins
SENSING = (
    "latency", "control_jitter", "observation_latency", "joint_noise", "position_noise", "joint_drift", "position_drift",
    "drift_time", "joint_offset", "position_offset",
)  # fmt: skip
# Parameters that are random during an episode, if they are not zero.
BY_CHANCE = ("control_jitter", "joint_noise", "position_noise", "joint_drift", "position_drift", "push_rate")
# Parameters that only describe how or how often another one acts.
MANNERS = {others[0] for others in NEEDS.values() if len(others) == 1}
RANGE_KEYS = {"uniform", "log_uniform", "one_of", "kind", "values", "low", "high"}  # keys of a range, as written and as stored
IDENTITY = {name: 1.0 if parameter.unit == "factor" else 0.0 for name, parameter in PARAMETERS.items()}


class Distribution(BaseModel):
    """A distribution of parameter values."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["uniform", "log_uniform", "one_of", "fixed", "between"]
    values: tuple[Annotated[float, Strict()], ...]  # of `between` first the lowest of each joint or axis, then the highest

    @model_validator(mode="before")
    @classmethod
    def _short(cls, given: Any) -> Any:
        if isinstance(given, int | float) and not isinstance(given, bool):
            return {"kind": "one_of", "values": (given,)}
        if isinstance(given, Mapping) and len(given) == 1 and next(iter(given)) in ("uniform", "log_uniform", "one_of"):
            kind, values = next(iter(given.items()))
            return {"kind": kind, "values": values}
        if isinstance(given, Mapping) and set(given) == {"values"}:
            return {"kind": "fixed", **given}
        if isinstance(given, Mapping) and set(given) == {"low", "high"}:
            low, high = given["low"], given["high"]
            if not isinstance(low, list | tuple) or not isinstance(high, list | tuple) or len(low) != len(high):
                raise ValueError("low and high are two lists of the same length, one value for each joint or axis")
            return {"kind": "between", "values": (*low, *high)}
        if (isinstance(given, Mapping) and set(given) == {"kind", "values"}) or isinstance(given, Distribution):
            return given
        raise ValueError(
            "expected a number, or one of {uniform = [low, high]}, {log_uniform = [low, high]}, {one_of = [...]},"
            " {values = [one for each joint or axis]}, {low = [one for each], high = [one for each]}"
        )

    @model_validator(mode="after")
    def _ordered(self) -> Distribution:
        if not self.values:
            raise ValueError("no values to choose from")
        if self.kind in ("uniform", "log_uniform") and (len(self.values) != 2 or self.values[0] > self.values[1]):
            raise ValueError(f"{self.kind} takes [low, high] with low <= high, got {list(self.values)}")
        if self.kind == "log_uniform" and self.values[0] <= 0:
            raise ValueError(f"log_uniform needs positive bounds, got {list(self.values)}")
        if self.kind == "between" and (len(self.values) % 2 or np.greater(*self._ends).any()):
            raise ValueError(f"every value of low is at most that of high, got {list(self.values)}")
        return self

    @property
    def _ends(self) -> tuple[Array, Array]:
        """Return the lowest and the highest value of each joint or axis, of `between`."""
        half = len(self.values) // 2
        return np.array(self.values[:half]), np.array(self.values[half:])

    @property
    def width(self) -> int | None:
        """Return for how many joints or axes there are values, None if for any number."""
        return {"fixed": len(self.values), "between": len(self.values) // 2}.get(self.kind)

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Draw values of the given shape; fixed ones along its last axis."""
        if self.kind == "fixed":
            return np.broadcast_to(np.array(self.values), shape).copy()
        if self.kind == "between":
            return rng.uniform(*self._ends, shape)
        if self.kind == "one_of":
            drawn: Array = rng.choice(np.array(self.values), shape)
            return drawn
        low, high = self.values
        if self.kind == "uniform":
            return rng.uniform(low, high, shape)
        logarithm: Array = rng.uniform(np.log(low), np.log(high), shape)
        return np.exp(logarithm)

    @property
    def constant(self) -> bool:
        """Return whether every draw is the same."""
        if self.kind == "between":
            return bool(np.equal(*self._ends).all())
        return self.kind == "fixed" or len(set(self.values)) == 1

    def quantile(self, share: Array) -> Array:
        """Return the quantiles of these shares in [0, 1); of a choice, the entry at that share of the list.

        Fixed values are along the last axis, whatever the shares.
        """
        if self.kind == "fixed":
            return np.broadcast_to(np.array(self.values), share.shape).copy()
        if self.kind == "between":
            lowest, highest = self._ends
            between: Array = lowest + share * (highest - lowest)
            return between
        if self.kind == "one_of":
            chosen: Array = np.array(self.values)[(share * len(self.values)).astype(int)]
            return chosen
        low, high = self.values
        if self.kind == "uniform":
            return low + share * (high - low)
        logarithm: Array = np.log(low) + share * (np.log(high) - np.log(low))
        return np.exp(logarithm)

    def __str__(self) -> str:
        """Describe the distribution briefly."""
        if self.kind == "fixed":
            return ", ".join(f"{value:g}" for value in self.values)
        if self.kind == "between":
            return ", ".join(f"{low:g} .. {high:g}" for low, high in zip(*self._ends, strict=True))
        if self.kind != "one_of":
            return f"{self.values[0]:g} .. {self.values[1]:g}" + (" (log)" if self.kind == "log_uniform" else "")
        return " or ".join(f"{value:g}" for value in self.values)


def closest(name: str, known: Iterable[str]) -> str:
    """Propose similar names, as the end of a sentence; empty if none is similar."""
    near = get_close_matches(name, list(known), n=2)
    return f", did you mean {' or '.join(map(repr, near))}?" if near else ""


def _known(ranges: dict[str, Distribution]) -> dict[str, Distribution]:
    for name in ranges:
        if name not in PARAMETERS:
            meant = closest(name, PARAMETERS) or "; parameters: " + ", ".join(PARAMETERS)
            raise ValueError(f"no parameter {name!r}{meant}")
    for name, values in ranges.items():
        _check(name, values)
        if name in NEEDS and not any(other in ranges for other in NEEDS[name]):
            raise ValueError(f"{name} has no effect without {' or '.join(NEEDS[name])}")
    return ranges


def _check(name: str, given: Distribution) -> None:
    size, unit, _, low, high = PARAMETERS[name]
    outside = [value for value in given.values if not low <= value <= high]
    if outside:
        told = "as a factor" if unit == "factor" else unit
        raise ValueError(f"{name} must lie between {low:g} and {high:g} {told}, got {outside[0]:g}")
    if given.width is not None and size != PER_JOINT and given.width != size:
        raise ValueError(f"{name} has {size} values in each episode, got {given.width}")


Distributions = Annotated[dict[str, Distribution], AfterValidator(_known)]


def _size(name: str, values: Distribution, joints: int) -> int:
    """Return the number of values of a parameter in an episode.

    Raises:
        UsageError: there are fixed values, but not one for each joint.
    """
    size = PARAMETERS[name].size or joints
    if values.width is not None and values.width != size:
        raise UsageError(
            f"{name} has {values.width} values, the arm {size} joints", "give one value for each joint, from the base on"
        )
    return size


def sample(ranges: Mapping[str, Distribution], episodes: int, rng: np.random.Generator, joints: int) -> dict[str, Array]:
    """Draw parameters for each episode of an arm with some joints, (E,) or (E, n) by name; see `PARAMETERS`.

    Raises:
        UsageError: fixed values do not fit the arm.
    """
    drawn = {}
    for name, values in sorted(ranges.items()):
        size = _size(name, values, joints)
        drawn[name] = values.draw(rng, (episodes,) if size == 1 else (episodes, size))
    return drawn


def sample_each(ranges: Mapping[str, Distribution], rngs: Sequence[np.random.Generator], joints: int) -> dict[str, Array]:
    """Draw like `sample`, each episode from its own generator: more episodes begin with the same ones."""
    drawn = [sample(ranges, 1, rng, joints) for rng in rngs]
    return {name: np.concatenate([episode[name] for episode in drawn]) for name in sorted(ranges)}


def repeats(ranges: Mapping[str, Distribution]) -> bool:
    """Return whether every episode is the same: nothing is drawn, and nothing is random during an episode."""
    return all(values.constant and (name not in BY_CHANCE or not any(values.values)) for name, values in ranges.items())


def latin_hypercube(ranges: Mapping[str, Distribution], count: int, rng: np.random.Generator, joints: int) -> dict[str, Array]:
    """Draw like `sample`, but evenly: every parameter takes one value from each of `count` equal shares of its range.

    Latin hypercube sampling (McKay, Beckman and Conover 1979): few robots cover the ranges as well as many.
    """
    filled = {}
    for name, values in sorted(ranges.items()):
        size = _size(name, values, joints)
        order = np.argsort(rng.random((count, size)), axis=0)
        share = (order + rng.random((count, size))) / max(1, count)
        drawn = values.quantile(share)
        filled[name] = drawn[:, 0] if size == 1 else drawn
    return filled


Span = tuple[float, float]


def check_span(span: Span) -> None:
    """Refuse a span that is not two increasing shares of the training.

    Raises:
        ValueError: it is not.
    """
    if not 0 <= span[0] <= span[1] <= 1:
        raise ValueError(f"a span is two shares of the training in order, between 0 and 1, got {list(span)}")


def phased_in(span: Span, progress: float) -> float:
    """Return the fraction of an effect that is phased in over a span: from 0 linearly to 1."""
    begin, full = span
    return float(progress >= begin) if begin == full else min(1.0, max(0.0, (progress - begin) / (full - begin)))


class Randomisation(Section):
    """Domain randomization during training (Tobin et al. 2017, Peng et al. 2018); none by default.

    Training from scratch under wide starts, latency and noise is slow. So they apply to a share of the simulations that grows
    over a span of the training.
    """

    dynamics: Distributions = value({}, "of the robot and the box, in every episode")
    starts: Distributions = value({}, "of where arm and box start, phased in over `starts_span`")
    sensing: Distributions = value({}, "of latency and sensors, phased in over `sensing_span`")
    starts_span: Span = value((0.05, 0.4), "shares of the training at which starts begin to vary, and vary everywhere", "")
    sensing_span: Span = value((0.5, 0.8), "shares of the training at which sensing begins to vary, and varies everywhere", "")

    @model_validator(mode="after")
    def _once_each(self) -> Randomisation:
        names = [*self.dynamics, *self.starts, *self.sensing]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{twice[0]} is named more than once")
        for span in (self.starts_span, self.sensing_span):
            check_span(span)
        return self

    @staticmethod
    def sorted(ranges: Mapping[str, Distribution]) -> dict[str, dict[str, Distribution]]:
        """Return the sections `dynamics`, `starts` and `sensing` with the distributions of a domain."""
        parts: dict[str, dict[str, Distribution]] = {"dynamics": {}, "starts": {}, "sensing": {}}
        for name, values in ranges.items():
            parts["starts" if name in STARTS else "sensing" if name in SENSING else "dynamics"][name] = values
        return parts

    @property
    def ranges(self) -> Distributions:
        """Return all distributions by name."""
        return {**self.dynamics, **self.starts, **self.sensing}
