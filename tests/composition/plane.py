"""A world without a simulator: a latent (vx, vy) moves the point by so much per control step; what leaves `inside` fails."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillcli.composition.latent_environment import Outcome
from skillcli.trajectories import Array

ORIGIN = np.zeros(3)


class Plane:
    def __init__(self, inside: Callable[[Array], Array] | None = None) -> None:
        self.inside, self.proposals = inside, 0

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        move = np.concatenate([latent, np.zeros((len(latent), 1))], axis=1)
        path = sim_states[:, None] + np.arange(steps + 1)[None, :, None] * move[:, None]
        failed = np.zeros(len(sim_states), dtype=bool) if self.inside is None else ~self.inside(path).all(axis=1)
        self.proposals += len(sim_states)
        return Outcome(path[:, None, :, None], failed[:, None], path[:, -1], path[:, None, -1, :2])
