"""What the latent space is worth as a map: places between the goals, each by the one latent that the map gives for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli import metrics
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.library import Library
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.hull import GoalMap
from skillcli.kinds.embed_means import MapOnRobots, MapQuality
from skillcli.seeding import generator
from skillcli.simulation.domains import find_domain
from skillcli.simulation.environment import NO_SKILL
from skillcli.trajectories import Array

PLACES = 200


@dataclass(frozen=True)
class JudgedMap:
    """Where latents of the map end that are held from the start to the end of an episode."""

    place: Array  # (P, 3) m, drawn uniformly in the hull of the goals
    latent: Array  # (P, d) Σ w_t mean_t, with Σ w_t goal_t = place
    end: Array  # (P, 3) m
    domain: str = ""  # from which robots were drawn for `end_on_robots`
    end_on_robots: Array | None = None  # (P, 3) m, each on a robot of its own

    def arrays(self) -> dict[str, Array]:
        """As the store keeps it."""
        elsewhere = {} if self.end_on_robots is None else {"map/end_on_robots": self.end_on_robots}
        return {"map/place": self.place, "map/latent": self.latent, "map/end": self.end, **elsewhere}

    @property
    def quality(self) -> MapQuality:
        """How far the ends are from the places."""
        on_robots = None
        if self.end_on_robots is not None:
            on_robots = MapOnRobots(domain=self.domain, **self._errors(self.end_on_robots))
        return MapQuality(
            places=len(self.place),
            latent_end_correlation=metrics.distance_correlation(self.latent, self.end),
            on_robots=on_robots,
            **self._errors(self.end),
        )

    def _errors(self, end: Array) -> dict[str, float]:
        """Return the distances of ends (P, 3) m from the places: median, 90 %, 95 % and largest, m."""
        distance = np.linalg.norm(end - self.place, axis=1)
        quantiles = {"median_m": 0.5, "p90_m": 0.9, "p95_m": 0.95, "max_m": 1.0}
        return {name: float(np.quantile(distance, share)) for name, share in quantiles.items()}


def judge_map(library: Library, seed: int) -> JudgedMap:
    """Draw places, hold the latent that the map gives for each, and see where it ends.

    Once on the nominal robot, and once each on another robot of the domain `compose.robots`, where an arm takes part.
    Episodes begin where those of the skill do that has most part in the place: a block that is carried is in the hand.
    """
    goal_map = GoalMap.of(library.goals, library.mean, library.world.task.mixing)
    place = goal_map.hull.draw(PLACES, generator(seed, "places of the map"))
    latent, start = goal_map.latents(place), goal_map.nearest(place)

    def ends(robots: SampledRobots | None) -> Array:
        no_skill = np.full(PLACES, NO_SKILL)
        recording, _ = rollout_held(library.world, library.agent, latent, place, no_skill, start=start, robots=robots)
        found: Array = recording.achieved_goal[np.arange(PLACES), recording.length]
        return found

    if not library.world.spec.uses_robot:
        return JudgedMap(place, latent, ends(None))
    domain = library.recipe.compose.robots
    robots = SampledRobots.drawn(domain, seed, library.world.joints, PLACES)
    return JudgedMap(place, latent, ends(None), find_domain(domain).name, ends(robots))
