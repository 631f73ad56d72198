"""Places between goals, as weighted means of them: which weights give a place, places at random, and their latents.

A place p in the convex hull of goals g_1 .. g_K is p = Σ w_t g_t with weights w_t >= 0 that add to one. For the 2^k corners of
a cuboid they are multilinear in the place: with its coordinates u in [0, 1]^k along the edges,

    w_t = Π_i (u_i where corner t lies at the far end of edge i, 1 - u_i where it lies at the near end)

For other goals several weights may give one place. Then the most even ones are taken, those with the smallest Σ w_t².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skillcli.metrics import neighbours
from skillcli.trajectories import Array

_EXACT = 1e-6  # of the size of a hull: two places nearer than this are one
_STRICT = 1e4  # how much more the place counts than even weights; its error is the square of one over this


@dataclass(frozen=True, eq=False)
class Cuboid:
    """Goals that are the corners of a cuboid with k edges: a segment, a rectangle, a box, in any direction."""

    origin: Array  # (3,) m, the first goal
    edges: Array  # (k, 3) m, from there
    far: Array  # (K, k) 0 or 1, the end of each edge at which each goal lies

    @staticmethod
    def of(goals: Array) -> Cuboid | None:
        """The cuboid with these corners (K, 3) m in any order, None where there is none."""
        edges = np.array([goals[b] - goals[0] for a, b in neighbours(goals) if a == 0]).reshape(-1, 3)
        products, size = edges @ edges.T, float(np.ptp(goals, axis=0).max())
        squared = np.diag(products)
        if len(goals) != 2 ** len(edges) or (np.abs(products - np.diag(squared)) > _EXACT * size**2).any():
            return None
        if (squared <= (_EXACT * size) ** 2).any():
            return None
        far = np.round((goals - goals[0]) @ edges.T / squared)
        corners = goals[0] + far @ edges
        if np.abs(corners - goals).max() > _EXACT * size or len(np.unique(far, axis=0)) < len(goals):
            return None
        return Cuboid(goals[0], edges, far)

    def coordinates(self, places: Array) -> Array:
        """Along the edges, each from 0 to 1 inside: (n, 3) m to (n, k)."""
        found: Array = (places - self.origin) @ self.edges.T / (self.edges**2).sum(axis=1)
        return found

    def weights(self, coordinates: Array) -> Array:
        """Multilinear weights of the corners: (n, k) in [0, 1] to (n, K)."""
        inside = coordinates[:, None]
        found: Array = np.where(self.far == 1, inside, 1 - inside).prod(axis=2)
        return found


@dataclass(frozen=True, eq=False)
class Hull:
    """The convex hull of goals (K, 3) m."""

    goals: Array

    @cached_property
    def cuboid(self) -> Cuboid | None:
        """Their cuboid, where they are the corners of one."""
        return Cuboid.of(self.goals)

    @cached_property
    def size(self) -> float:
        """Its longest side along the axes, m."""
        return float(np.ptp(self.goals, axis=0).max())

    def weights(self, places: Array) -> Array:
        """Weights of the goals that give places, or the nearest ones in the hull: (n, 3) m to (n, K)."""
        if self.cuboid is not None:
            return self.cuboid.weights(self.cuboid.coordinates(places).clip(0, 1))
        from scipy.optimize import nnls  # slow to import, and only needed here

        goals = (self.goals - self.goals[0]).T / (self.size or 1.0)
        count = len(self.goals)
        rows = np.concatenate([_STRICT * goals, np.full((1, count), _STRICT), np.eye(count)])
        wanted = (places - self.goals[0]) / (self.size or 1.0)
        found = np.array([nnls(rows, np.array([*_STRICT * place, _STRICT, *np.zeros(count)]))[0] for place in wanted])
        weights: Array = found / found.sum(axis=1, keepdims=True)
        return weights

    def inside(self, places: Array) -> Array:
        """Return places, or the nearest ones in the hull: (n, 3) m."""
        found: Array = self.weights(places) @ self.goals
        return found

    def gap(self, places: Array) -> Array:
        """How far places are outside, (n, 3) m to (n,) m."""
        distance: Array = np.linalg.norm(self.inside(places) - places, axis=1)
        return distance

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Places drawn uniformly from it, (count, 3) m."""
        if self.cuboid is not None:
            return self.cuboid.origin + rng.random((count, len(self.cuboid.edges))) @ self.cuboid.edges
        centre = self.goals.mean(axis=0)
        _, spread, axes = np.linalg.svd(self.goals - centre, full_matrices=False)
        axes = axes[spread > _EXACT * self.size]  # goals in one plane have a flat hull
        along = (self.goals - centre) @ axes.T
        found: Array = np.zeros((0, 3))
        while len(found) < count:
            places = centre + rng.uniform(along.min(axis=0), along.max(axis=0), (count, len(axes))) @ axes
            found = np.concatenate([found, places[self.gap(places) <= _EXACT * self.size]])
        return found[:count]


@dataclass(frozen=True, eq=False)
class GoalMap:
    """What mixtures make of the latent space: Σ w_t mean_t, the latent of the place Σ w_t goal_t."""

    goals: Array  # (M, 3) m, of the skills that can be mixed
    mean: Array  # (M, d) their latents
    skills: tuple[int, ...]  # (M,) their indices

    @staticmethod
    def of(goals: Array, mean: Array, mixing: Sequence[int]) -> GoalMap:
        """Make the map of a library with goals (K, 3) m and means (K, d), of which those of some skills can be mixed."""
        chosen = list(mixing)
        return GoalMap(goals[chosen], mean[chosen], tuple(chosen))

    @cached_property
    def hull(self) -> Hull:
        """The places that it covers."""
        return Hull(self.goals)

    def latents(self, places: Array) -> Array:
        """Return the latents of places, or of the nearest ones in the hull: (n, 3) m to (n, d)."""
        found: Array = self.hull.weights(places) @ self.mean
        return found

    def nearest(self, places: Array) -> Array:
        """Return the skill (n,) that has most part in each place (n, 3) m."""
        found: Array = np.array(self.skills)[self.hull.weights(places).argmax(axis=1)]
        return found
