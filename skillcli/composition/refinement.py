"""Latents between the declared ones, where no sequence of those comes near enough.

Pattern search (Hooke and Jeeves 1961) over the last latent of the nearest plans: its neighbours along each dimension of the
latent space are tried, and the best takes its place; where none is better, the neighbours move in to half the distance.
"""

from __future__ import annotations

import numpy as np

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.search import Node, UniformCostSearch
from skillcli.trajectories import Array

PLANS = 6  # that are refined side by side: where latents jump from one place to another, the nearest may lead nowhere


class Refinement:
    """What a search found, refined, as a `Planner`. The last latent is held for the longest duration.

    Args:
        search: that has ended.
        box: (2, d) lowest and highest latent.
        spacing: (d,) how far off the first neighbours are.
        rounds: of trying all neighbours.
    """

    def __init__(self, search: UniformCostSearch, box: Array, spacing: Array, rounds: int) -> None:
        self.search, self._box, self._rounds, self._round = search, box, rounds, 0
        self._plans: list[Node] = sorted(search.kept, key=search.merit)[:PLANS]
        self._spacing = np.tile(spacing, (len(self._plans), 1))
        self._offsets = np.concatenate([np.eye(len(spacing)), -np.eye(len(spacing))])
        self._steps = max(search.settings.durations)
        self.replayed = 0.0  # as of `Expansions`

    @property
    def width(self) -> int:
        """How many latents are tried at once."""
        return len(self._plans) * len(self._offsets)

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        return self._round >= self._rounds or not self._plans or self.search.goal is not None

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        return self._round, self._rounds, "between the latents"

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self.search.plan(self.search.best)

    def ask(self) -> Proposal:
        """See `Planner`."""
        now = self.search.choices.latent[[node.choice for node in self._plans]]
        around = now[:, None] + self._spacing[:, None] * self._offsets
        latent = np.clip(around, *self._box).reshape(-1, now.shape[1])
        self._parents = [node.parent for node in self._plans if node.parent is not None for _ in self._offsets]
        self._choice = self.search.offer(latent)
        return Proposal(np.stack([parent.row for parent in self._parents]), latent, self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        found = self.search.reached(self._parents, self._choice, outcome, self._steps)
        neighbours = len(self._offsets)
        for i, node in enumerate(self._plans):
            better = [child for child in found[i * neighbours :][:neighbours] if child is not None]
            best = min(better, key=self.search.merit, default=node)
            if self.search.merit(best) < self.search.merit(node):
                self._plans[i] = best
                self.search.keep(best)
            else:
                self._spacing[i] /= 2
        self.replayed += sum(parent.cost for parent in self._parents)
        self._round += 1
