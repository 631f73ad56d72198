"""Mixtures of skills in training, which make the latent space a map: the mixture of latents leads to the mixture of goals.

In a share of the episodes weights w of the skills are drawn, w_t >= 0 and Σ w_t = 1, and with one epsilon per episode

    z = Σ w_t mean_t + (Σ w_t std_t) * epsilon        goal = Σ w_t goal_t

Reward, start and all else of the episode are as ever; a skill alone is the mixture with a single weight of one. The policy
ratio is evaluated at the z that the present embedding gives to the same w and epsilon, so that means and standard deviations
learn from mixtures as well, each by its weight. The value function sees w in place of the skill's one-hot.

It is the idea of mixup (Zhang, Cisse, Dauphin and Lopez-Paz 2018, arXiv:1710.09412), to train on convex combinations of
examples and to ask for the same combination of their labels, applied to latents and goals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillcli.errors import UsageError
from skillcli.hull import Hull
from skillcli.learning.settings import Mixtures
from skillcli.metrics import neighbours
from skillcli.trajectories import Array

MIXED = -1
"""The skill of an episode that has none of its own."""


@dataclass(frozen=True)
class Mixer:
    """Gives some episodes of a rollout weights of several skills."""

    share: float  # of the episodes, in the mean
    draw: Callable[[int, np.random.Generator], Array]  # weights (n, K) of n mixtures

    def mix(self, skill: Array, skills: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Skills (N,) out of K, to skills (N,), those of mixtures `MIXED`, and weights (N, K), one-hot but for mixtures.

        Without a share nothing is drawn: training is then what it is without mixtures, bit for bit.
        """
        weights = np.eye(skills)[skill]
        if self.share == 0:
            return skill, weights
        mixed = rng.random(len(skill)) < self.share
        weights[mixed] = self.draw(int(mixed.sum()), rng)
        return np.where(mixed, MIXED, skill), weights

    @staticmethod
    def of(mixtures: Mixtures, goals: Array) -> Mixer:
        """What a recipe says of mixtures of these goals (K, 3) m.

        Raises:
            UsageError: such weights cannot be drawn for these goals.
        """
        return Mixer(mixtures.share, _DRAWERS[mixtures.weights](mixtures, goals)) if mixtures.share else UNMIXED


UNMIXED = Mixer(0.0, lambda count, _: np.zeros((count, 0)))
"""Every episode has a skill of its own."""


def _multilinear(_: Mixtures, goals: Array) -> Callable[[int, np.random.Generator], Array]:
    """Those of a place drawn uniformly from the cuboid whose corners the goals are."""
    hull = Hull(goals)
    if hull.cuboid is None:
        raise UsageError(
            f'mixtures.weights = "multilinear" needs goals that are the corners of a cuboid, these {len(goals)} are not',
            'take "dirichlet", which mixes any goals',
        )
    return lambda count, rng: hull.weights(hull.draw(count, rng))


def _neighbours(_: Mixtures, goals: Array) -> Callable[[int, np.random.Generator], Array]:
    """Those of a place on the way between two neighbouring goals, any pair alike, any place alike."""
    pairs = np.array(neighbours(goals), dtype=int).reshape(-1, 2)
    if not len(pairs):
        raise UsageError('mixtures.weights = "neighbours" needs two goals at least', "leave mixtures out")

    def draw(count: int, rng: np.random.Generator) -> Array:
        ends, along = pairs[rng.integers(len(pairs), size=count)], rng.random(count)
        one_hot = np.eye(len(goals))
        weights: Array = (1 - along)[:, None] * one_hot[ends[:, 0]] + along[:, None] * one_hot[ends[:, 1]]
        return weights

    return draw


def _dirichlet(mixtures: Mixtures, goals: Array) -> Callable[[int, np.random.Generator], Array]:
    """Drawn from a symmetric Dirichlet distribution."""
    concentration = np.full(len(goals), mixtures.concentration)
    return lambda count, rng: rng.dirichlet(concentration, count)


_DRAWERS = {"multilinear": _multilinear, "neighbours": _neighbours, "dirichlet": _dirichlet}
