"""Target domains: robots that differ from the simulation, as ranges of parameters drawn anew for every episode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillcli.errors import UsageError
from skillcli.trajectories import Array


@dataclass(frozen=True)
class Uniform:
    """Equally likely between low and high."""

    low: float
    high: float

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Values of the given shape."""
        return rng.uniform(self.low, self.high, shape)


@dataclass(frozen=True)
class LogUniform:
    """Equally likely per octave between low and high, both positive."""

    low: float
    high: float

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Values of the given shape."""
        values: Array = np.exp(rng.uniform(math.log(self.low), math.log(self.high), shape))
        return values


@dataclass(frozen=True)
class OneOf:
    """One of these values."""

    values: tuple[float, ...]

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Values of the given shape."""
        return rng.choice(np.array(self.values), shape)


Range = Uniform | LogUniform | OneOf

# What a domain may change: (values per episode, unit, meaning). Factors multiply the model's own value.
PARAMETERS: dict[str, tuple[int, str, str]] = {
    "link_mass": (7, "factor", "mass and inertia of the link behind each joint; the controller still knows the true weight"),
    "gravity_compensation": (1, "factor", "share of the arm's weight that the controller compensates"),
    "joint_damping": (7, "factor", "viscous damping of each joint"),
    "joint_friction": (7, "factor", "dry friction of each joint"),
    "gain": (7, "factor", "stiffness of each servo, its damping with it"),
    "contact_friction": (1, "factor", "sliding friction of the table"),
    "table_height": (1, "m", "offset of the table top"),
    "latency": (1, "s", "delay between a command and its effect, at most 0.155 s"),
    "joint_noise": (1, "rad", "standard deviation of white noise on measured joint angles"),
    "position_noise": (1, "m", "standard deviation of white noise on measured positions"),
    "start_offset": (7, "rad", "offset of each joint from the start pose"),
}


@dataclass(frozen=True)
class Domain:
    """A named target: what differs from the source, by how much, and why."""

    name: str
    description: str
    parameters: dict[str, Range]


# Sources. robosuite: defaults of its dynamics randomisation (mass 2 %, friction 10 %, table height 1.5 mm). Peng et al.
# 2018 (arXiv:1710.06537): latency 40 ms, gains, damping. OpenAI 2018 (arXiv:1808.00177): one step of latency with
# probability one half, friction 0.7-1.3, masses 0.5-1.5. The widths of real-like are those with which composed pushes
# were seen to fail: friction and mass 40 %, gains 30 %, one control step of latency, 5 mrad and 3 mm of noise.
DOMAINS: dict[str, Domain] = {
    domain.name: domain
    for domain in (
        Domain("nominal", "the simulation itself, nothing changed", {}),
        Domain(
            "mild",
            "a well identified robot: small errors of mass, friction, gains and sensors, no latency",
            {
                "link_mass": Uniform(0.98, 1.02),
                "joint_damping": Uniform(0.9, 1.1),
                "joint_friction": Uniform(0.9, 1.1),
                "gain": Uniform(0.95, 1.05),
                "contact_friction": Uniform(0.9, 1.1),
                "table_height": Uniform(-0.0015, 0.0015),
                "joint_noise": Uniform(0.001, 0.001),
                "position_noise": Uniform(0.001, 0.001),
                "start_offset": Uniform(-0.005, 0.005),
            },
        ),
        Domain(
            "real-like",
            "a robot known from its data sheet only: wide errors, latency in half of the episodes, noisy sensors",
            {
                "link_mass": Uniform(0.6, 1.4),
                "gravity_compensation": Uniform(0.9, 1.1),
                "joint_damping": LogUniform(0.5, 2.0),
                "joint_friction": Uniform(0.6, 1.4),
                "gain": Uniform(0.7, 1.3),
                "contact_friction": Uniform(0.6, 1.4),
                "table_height": Uniform(-0.005, 0.005),
                "latency": OneOf((0.0, 0.05)),
                "joint_noise": Uniform(0.005, 0.005),
                "position_noise": Uniform(0.003, 0.003),
                "start_offset": Uniform(-0.02, 0.02),
            },
        ),
    )
}


def find_domain(name: str) -> Domain:
    """The preset of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in DOMAINS:
        raise UsageError(f"no domain {name!r}", f"domains: {', '.join(DOMAINS)}; see `skill domains`")
    return DOMAINS[name]


def sample(domain: Domain, episodes: int, rng: np.random.Generator) -> dict[str, Array]:
    """Draw the domain's parameters for each episode, (E,) or (E, 7) by name; see `PARAMETERS`."""
    drawn = {}
    for name, values in domain.parameters.items():
        size = PARAMETERS[name][0]
        drawn[name] = values.draw(rng, (episodes,) if size == 1 else (episodes, size))
    return drawn
