"""Train on mixtures of skills, so that the latent space becomes a map: mixed latents lead to mixed goals.

In a share of the episodes weights w of the skills are drawn, w_t >= 0 and Σ w_t = 1, and with one epsilon per episode

    z = Σ w_t mean_t + (Σ w_t std_t) * epsilon        goal = Σ w_t goal_t

Reward, start and everything else of the episode are unchanged; a single skill is the mixture with one weight of one. The
policy ratio is evaluated at the z that the present embedding gives to the same w and epsilon, so that means and standard
deviations learn from mixtures too, each by its weight. The value function observes w in place of the skill's one-hot.
A task says which of its skills can be mixed (`TaskSettings.mixing`): those that do the same with another goal.

The idea is that of mixup (Zhang, Cisse, Dauphin and Lopez-Paz 2018, arXiv:1710.09412), which trains on convex combinations
of examples and their labels, here of latents and goals.
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
"""The skill of an episode with a mixture."""


@dataclass(frozen=True)
class Mixer:
    """Gives some episodes of a rollout a mixture of skills."""

    share: float  # of the episodes of these skills, in the mean
    draw: Callable[[int, np.random.Generator], Array]  # weights (n, M) of n mixtures
    mixing: tuple[int, ...] = ()  # the M skills that are mixed

    def mix(self, skill: Array, skills: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Replace some of the skills (N,) out of K by `MIXED`; return skills (N,) and weights (N, K), one-hot without mixture.

        Without a share nothing is drawn: training is then bit for bit the same as without mixtures.
        """
        weights = np.eye(skills)[skill]
        if self.share == 0:
            return skill, weights
        mixed = (rng.random(len(skill)) < self.share) & np.isin(skill, self.mixing)
        weights[mixed] = 0.0
        weights[np.ix_(np.flatnonzero(mixed), np.array(self.mixing, dtype=int))] = self.draw(int(mixed.sum()), rng)
        return np.where(mixed, MIXED, skill), weights

    @staticmethod
    def of(mixtures: Mixtures, goals: Array, mixing: tuple[int, ...]) -> Mixer:
        """Make the mixer of a recipe for these goals (K, 3) m, of which those of some skills can be mixed.

        Raises:
            UsageError: such weights cannot be drawn for these goals.
        """
        if not mixtures.share:
            return UNMIXED
        return Mixer(mixtures.share, _DRAWERS[mixtures.weights](mixtures, goals[list(mixing)]), mixing)


UNMIXED = Mixer(0.0, lambda count, _: np.zeros((count, 0)))
"""Every episode has a single skill."""


def _multilinear(_: Mixtures, goals: Array) -> Callable[[int, np.random.Generator], Array]:
    """Draw the weights of a place in the cuboid whose corners are the goals, uniformly."""
    hull = Hull(goals)
    if hull.cuboid is None:
        raise UsageError(
            f'mixtures.weights = "multilinear" needs goals that are the corners of a cuboid, these {len(goals)} are not',
            'take "dirichlet", which mixes any goals',
        )
    return lambda count, rng: hull.weights(hull.draw(count, rng))


def _neighbours(_: Mixtures, goals: Array) -> Callable[[int, np.random.Generator], Array]:
    """Draw the weights of a place between two neighbouring goals; pair and place are uniform."""
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
    """Draw from a symmetric Dirichlet distribution."""
    concentration = np.full(len(goals), mixtures.concentration)
    return lambda count, rng: rng.dirichlet(concentration, count)


_DRAWERS = {"multilinear": _multilinear, "neighbours": _neighbours, "dirichlet": _dirichlet}
