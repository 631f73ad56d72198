"""Model predictive control over latents by the cross-entropy method (Rubinstein 1999; receding horizon: Chua et al. 2018).

Before every segment, sequences of latents are drawn around the best ones so far and tried in the simulator; the first
latent of the best is taken, its outcome is known already, and planning goes on from there with the rest of the sequence.
"""

from __future__ import annotations

import numpy as np

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.route import Route
from skillcli.methods import Mpc
from skillcli.trajectories import Array

MIN_SPREAD = 0.05  # of the box's half edges: the search never narrows to a point
FAILED = 1e3  # m to go, for a simulation that failed


class ModelPredictiveControl:
    """See `Planner`. In a round, (M, H) latents are tried segment by segment, all M sequences side by side.

    Args:
        row: (S,) the start state.
        points: (L, 3) m, the landmarks there.
        route: where to go.
        means: (K, d) of the skills; holding each is among the first sequences tried before every segment.
        box: (2, d) lowest and highest latent.
        settings: the recipe's.
        steps: control steps of one segment.
        longest: segments that a plan may have.
        rng: draws the sequences.
    """

    def __init__(
        self, row: Array, points: Array, route: Route, means: Array, box: Array, settings: Mpc, steps: int, longest: int,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._row, self._points, self._due = row, points, np.zeros(1, dtype=int)
        self._route, self._means, self._settings = route, means, settings
        self._box, self._steps, self._longest, self._rng = box, steps, longest, rng
        self._half = (box[1] - box[0]) / 2
        self._mean = np.tile(box.mean(axis=0), (settings.lookahead, 1))  # (H, d)
        self._segments: list[Segment] = []
        self._round = 0
        self._draw()

    def _draw(self) -> None:
        """Begin a round: new sequences, all from the present state."""
        samples, lookahead = self._settings.samples, self._settings.lookahead
        if self._round == 0:
            self._spread = np.tile(self._half, (lookahead, 1))
            self._best: tuple[float, Array] | None = None
        noise = self._rng.standard_normal((samples, lookahead, len(self._half)))
        drawn = np.clip(self._mean + self._spread * noise, *self._box)
        drawn[0] = self._mean
        if self._round == 0:
            held = self._means[: samples - 1]
            drawn[1 : 1 + len(held)] = held[:, None]
        elif self._best is not None:
            drawn[1] = self._best[1]
        self._sequences: Array = drawn
        self._rows: Array = np.tile(self._row, (samples, 1))
        self._dues: Array = np.tile(self._due, samples)
        self._broken: Array = np.zeros(samples, dtype=bool)
        self._cost: Array = np.zeros(samples)
        self._at = 0

    @property
    def finished(self) -> bool:
        """See `Planner`: at the last waypoint, or out of time."""
        return self._arrived() or len(self._segments) >= self._longest

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        left = float(self._route.left(self._due, self._points[None])[0])
        return len(self._segments), self._longest, f"{left:.3f} m to go"

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self._segments

    def ask(self) -> Proposal:
        """See `Planner`: the next segment of all sequences of this round."""
        return Proposal(self._rows, self._sequences[:, self._at], self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        self._dues = self._route.advance(self._dues, outcome.path)
        self._broken |= outcome.failed
        points = outcome.path[:, -1]
        self._cost += np.where(self._broken, FAILED, self._route.left(self._dues, points))
        self._rows = outcome.rows
        if self._at == 0:
            self._first = outcome.rows, points, self._dues
        self._at += 1
        if self._at == self._settings.lookahead:
            self._judge()

    def _judge(self) -> None:
        """End a round: narrow down around the elites, or take the first latent of the best sequence."""
        order = np.argsort(self._cost, kind="stable")
        elites = self._sequences[order[: self._settings.elites]]
        best = int(order[0])
        self._mean = elites.mean(axis=0)
        self._spread = np.maximum(elites.std(axis=0), MIN_SPREAD * self._half)
        self._best = float(self._cost[best]), self._sequences[best]
        self._round += 1
        if self._round == self._settings.rounds:
            self._take(best)
        if not self.finished:
            self._draw()

    def _take(self, best: int) -> None:
        sequence = self._sequences[best]
        rows, points, dues = self._first
        self._row, self._points, self._due = rows[best], points[best], dues[best : best + 1]
        self._segments.append(Segment(sequence[0], -1, "latent", self._steps))
        self._mean = np.concatenate([sequence[1:], sequence[-1:]])
        self._round = 0

    def _arrived(self) -> bool:
        at_last = int(self._due[0]) == len(self._route.waypoints) - 1
        return at_last and float(self._route.final_gap(self._points[None])[0]) <= self._settings.goal_tolerance
