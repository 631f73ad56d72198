"""The robots on which a plan is tried: the nominal one, an ensemble, or one drawn from a target domain."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from skillcli.config import randomization
from skillcli.recipe import Compose
from skillcli.seeding import generator
from skillcli.simulation.domains import find_domain
from skillcli.simulation.environment import NO_SKILL, Environment
from skillcli.tasks.world import World
from skillcli.trajectories import Array


@dataclass(frozen=True)
class SampledRobots:
    """M robots; without parameters all are nominal."""

    parameters: dict[str, Array] = field(default_factory=dict)  # (M,) or (M, n) by name, see `skillcli.config.randomization`
    count: int = 1
    seed: int = 0  # of their sensor noise

    @staticmethod
    def of(settings: Compose, on: str, seed: int, joints: int) -> SampledRobots:
        """Choose the robots of a composition: one of the target domain `on`, an ensemble, or the nominal robot.

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
    def drawn(domain: str, seed: int, joints: int, count: int = 1) -> SampledRobots:
        """Draw one robot from a domain, or several."""
        drawn = randomization.sample(find_domain(domain).parameters, count, generator(seed, f"target {domain}"), joints)
        return SampledRobots(drawn, count, seed)

    @staticmethod
    def ensemble(domain: str, count: int, seed: int, joints: int) -> SampledRobots:
        """Return the nominal robot and others spread evenly over a domain (Latin hypercube)."""
        ranges = find_domain(domain).parameters
        drawn = randomization.latin_hypercube(ranges, count - 1, generator(seed, f"ensemble {domain}"), joints)
        whole = {
            name: np.concatenate([np.full((1, *values.shape[1:]), randomization.IDENTITY[name]), values])
            for name, values in drawn.items()
        }
        return SampledRobots(whole, count, seed)

    def make_env(self, world: World, slots: int) -> Environment:
        """Make each robot in every slot, at the start; simulation i is robot i modulo M."""
        which = np.arange(slots * self.count) % self.count
        parameters = {name: values[which] for name, values in self.parameters.items()}
        return world.make_randomized_env(np.full(len(which), NO_SKILL), parameters, generator(self.seed, "sensors"))
