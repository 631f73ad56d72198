"""The methods of composition, one line each: a description, and the module whose `METHOD` says everything else.

A module is imported only when its method is needed. So listing the methods is fast, and a method that learns may live in a
higher package.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from skillcli.errors import UsageError

if TYPE_CHECKING:
    from skillcli.composition.method import MethodSpec


@dataclass(frozen=True)
class Method:
    """One line of the table."""

    about: str  # one-line description
    module: str

    @property
    def spec(self) -> MethodSpec:
        """Import the method's module and return its spec."""
        spec: MethodSpec = import_module(self.module).METHOD
        return spec


METHODS = {
    "search": Method(
        "goals in order, over the means (and half-way latents): shortest plan first, A*, or greedy",
        "skillcli.composition.search",
    ),
    "map": Method(
        "one latent for a goal between the trained ones, corrected by a few trials; for skills trained with mixtures",
        "skillcli.composition.latent_map",
    ),
    "interpolate": Method(
        "hold one skill, blend into the next, hold it; with a calibration of the latents between all pairs",
        "skillcli.composition.interpolation",
    ),
    "sequence": Method("a plan written by hand, such as 3,4,8,7 or 3:1.0,3~4:1.0,4:1.0", "skillcli.composition.sequence"),
    "ddpg": Method(
        "a composer that learns off-policy which latent to choose, over all latents or a discrete set",
        "skillcli.learning.ddpg_method",
    ),
    "ppo": Method("the same with the on-policy learner", "skillcli.learning.ppo_method"),
    "mpc": Method(
        "sampled sequences of latents, replanned for every segment; plans faster than the robot moves",
        "skillcli.composition.mpc",
    ),
    "sb3": Method(
        "a policy that Stable-Baselines3 learned on skill/Latent-v0, given as --method sb3:FILE.zip",
        "skillcli.learning.sb3_method",
    ),
}
DEFAULT = "search"


def method_spec(name: str) -> MethodSpec:
    """Return the method of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in METHODS:
        raise UsageError(f"no method {name!r}", f"methods: {', '.join(METHODS)}")
    return METHODS[name].spec


def split_method(text: str) -> tuple[str, dict[str, str]]:
    """Split `NAME` or `NAME:VALUE` into the method's name and the option that the value sets.

    Raises:
        UsageError: there is no such method, or it takes no value.
    """
    name, colon, value = text.partition(":")
    argument = method_spec(name).argument
    if not colon:
        return name, {}
    if not argument:
        raise UsageError(f"--method {name} takes no value, got {value!r}", f"give --method {name}")
    return name, {argument: value}


def all_specs() -> dict[str, MethodSpec]:
    """Return the spec of every method by name."""
    return {name: method.spec for name, method in METHODS.items()}


def replanning() -> list[str]:
    """List the methods that can plan again during an episode."""
    return [name for name, spec in all_specs().items() if spec.replans]
