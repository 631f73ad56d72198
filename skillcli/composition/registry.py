"""Which ways to compose there are, one line each: what it is, and the module whose `METHOD` says everything else.

Modules are named and imported only when they are needed: a list of the methods takes no time, and what learns may lie above
this package, with what it learns with.
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
    """A line of the table."""

    about: str  # what it is, in one line
    module: str

    @property
    def spec(self) -> MethodSpec:
        """Everything else about it."""
        spec: MethodSpec = import_module(self.module).METHOD
        return spec


METHODS = {
    "search": Method(
        "goals in order, over the means (and half-way latents): shortest plan first, A*, or greedy",
        "skillcli.composition.search",
    ),
    "interpolate": Method(
        "hold one skill, blend into the next, hold it; with a calibration of the latents between all pairs",
        "skillcli.composition.interpolation",
    ),
    "sequence": Method("a plan written by hand, such as 3,4,8,7 or 3:1.0,3~4:1.0,4:1.0", "skillcli.composition.sequence"),
    "ddpg": Method(
        "a composer that learns off-policy which latent to choose, over all latents or a discrete set", "skillcli.learning.ddpg"
    ),
    "ppo": Method("the same with the on-policy learner", "skillcli.learning.ppo"),
    "mpc": Method(
        "sampled sequences of latents, replanned for every segment; plans faster than the robot moves",
        "skillcli.composition.mpc",
    ),
}
DEFAULT = "search"


def method_spec(name: str) -> MethodSpec:
    """The method of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in METHODS:
        raise UsageError(f"no method {name!r}", f"methods: {', '.join(METHODS)}")
    return METHODS[name].spec


def all_specs() -> dict[str, MethodSpec]:
    """Every method by its name."""
    return {name: method.spec for name, method in METHODS.items()}
