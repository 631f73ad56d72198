"""What the latent space is worth as a map: places between the goals, each by the one latent that the map gives for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli import metrics
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.library import Library
from skillcli.hull import GoalMap
from skillcli.kinds.embed_means import MapQuality
from skillcli.seeding import generator
from skillcli.trajectories import Array

PLACES = 200


@dataclass(frozen=True)
class JudgedMap:
    """Where latents of the map end that are held from the start to the end of an episode."""

    place: Array  # (P, 3) m, drawn uniformly in the hull of the goals
    latent: Array  # (P, d) Σ w_t mean_t, with Σ w_t goal_t = place
    end: Array  # (P, 3) m

    def arrays(self) -> dict[str, Array]:
        """As the store keeps it."""
        return {"map/place": self.place, "map/latent": self.latent, "map/end": self.end}

    @property
    def quality(self) -> MapQuality:
        """How far the ends are from the places."""
        distance = np.linalg.norm(self.end - self.place, axis=1)
        median, p90, p95 = (float(np.quantile(distance, share)) for share in (0.5, 0.9, 0.95))
        return MapQuality(
            places=len(distance),
            median_m=median,
            p90_m=p90,
            p95_m=p95,
            max_m=float(distance.max()),
            latent_end_correlation=metrics.distance_correlation(self.latent, self.end),
        )


def judge_map(library: Library, seed: int) -> JudgedMap:
    """Draw places, hold the latent that the map gives for each, and see where it ends; on the nominal robot.

    Episodes begin where those of the skill do that has most part in the place: a block that is carried is in the hand.
    """
    goal_map = GoalMap.of(library.goals, library.mean, library.world.task.mixing)
    place = goal_map.hull.draw(PLACES, generator(seed, "places of the map"))
    latent, start = goal_map.latents(place), goal_map.nearest(place)
    recording = rollout_held(library.world, library.agent, latent, place, np.full(PLACES, -1), start=start)[0]
    return JudgedMap(place, latent, recording.achieved_goal[np.arange(PLACES), recording.length])
