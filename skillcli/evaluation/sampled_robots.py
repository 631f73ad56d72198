"""The robots that a plan is tried on: the nominal one, several at once, or one drawn from the domain that is planned on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from skillcli.config import randomization
from skillcli.recipe import Compose
from skillcli.seeding import generator
from skillcli.simulation.domains import find_domain
from skillcli.simulation.environment import Environment
from skillcli.tasks.world import World
from skillcli.trajectories import Array


@dataclass(frozen=True)
class SampledRobots:
    """M robots; without parameters the nominal one."""

    parameters: dict[str, Array] = field(default_factory=dict)  # (M,) or (M, n) by name, see `skillcli.config.randomization`
    count: int = 1
    seed: int = 0  # of their sensors

    @staticmethod
    def of(settings: Compose, on: str, seed: int, joints: int) -> SampledRobots:
        """What a composition asks for: the target that is planned on, or an ensemble, or neither.

        Raises:
            UsageError: the domain is unknown.
        """
        if on:
            return SampledRobots.drawn(on, seed, joints)
        return (
            SampledRobots.ensemble(settings.robots, settings.ensemble, seed, joints)
            if settings.ensemble > 1
            else SampledRobots()
        )

    @staticmethod
    def drawn(domain: str, seed: int, joints: int) -> SampledRobots:
        """One robot out of a domain."""
        drawn = randomization.sample(find_domain(domain).parameters, 1, generator(seed, f"target {domain}"), joints)
        return SampledRobots(drawn, 1, seed)

    @staticmethod
    def ensemble(domain: str, count: int, seed: int, joints: int) -> SampledRobots:
        """The nominal robot, and others that fill the ranges of a domain evenly."""
        ranges = find_domain(domain).parameters
        drawn = randomization.latin_hypercube(ranges, count - 1, generator(seed, f"ensemble {domain}"), joints)
        whole = {
            name: np.concatenate([np.full((1, *values.shape[1:]), randomization.IDENTITY[name]), values])
            for name, values in drawn.items()
        }
        return SampledRobots(whole, count, seed)

    def make_env(self, world: World, slots: int) -> Environment:
        """Each robot in every slot, at the start; simulation i is robot i modulo M."""
        which = np.arange(slots * self.count) % self.count
        parameters = {name: values[which] for name, values in self.parameters.items()}
        return world.make_randomized_env(np.zeros(len(which), dtype=np.int64), parameters, generator(self.seed, "sensors"))
