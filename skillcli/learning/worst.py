"""Repeat the episodes that end worst: same start, same goal.

Where some starts of a skill are never mastered while all others succeed, a policy has little reason to explore any more: such
starts are seen seldom, and what is learned of them is lost among the rest. So the quarter of each rollout that ends farthest
from its goal is kept for a while, and a share of the next episodes begins there. An episode that could not be better is not
repeated for ever: fewer are repeated than are kept, so each is drawn less than once before it is overwritten.

The idea is that of prioritised level replay (Jiang, Grefenstette and Rocktäschel 2021, arXiv:2010.03934), with the distance
from the goal as the score.
"""

from __future__ import annotations

import numpy as np

from skillcli.learning.ring_buffer import RingBuffer
from skillcli.trajectories import Array

KEPT = 0.25  # of the episodes of a rollout
ROLLOUTS = 16  # for which each is kept
MOST = 0.2  # largest share of episodes that repeat one; must be below KEPT


class WorstEpisodes(RingBuffer):
    """Whole states at the start (S), skills, and weights (K) of what was asked; for N episodes in a rollout."""

    def __init__(self, num_envs: int) -> None:
        self._each = round(KEPT * num_envs)
        super().__init__(max(1, ROLLOUTS * self._each))

    def keep(self, sim_states: Array, skill: Array, weights: Array, distance: Array) -> None:
        """Keep the worst quarter of a rollout: starts (N, S), skills (N,), weights (N, K) and final distances (N,) m."""
        worst = np.argsort(-distance, kind="stable")[: self._each]
        self.add(sim_states[worst], skill[worst], weights[worst])

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Sample starts (count, S), skills (count,) and weights (count, K); something must have been kept."""
        sim_states, skill, weights = self.sample(count, rng)
        return sim_states, skill.astype(np.int64), weights
