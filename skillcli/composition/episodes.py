"""A composition as a decision problem for a composer that learns: episodes from the start, an action is a latent.

What the composer sees: the observation of the robot, and the landmarks as seen from the waypoint that is due. What it gets
after each segment: minus the metres that are left to go. Episodes end by time (truncation) or by failure (termination).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.route import Route
from skillcli.trajectories import Array

FAILED = 5.0  # metres to go that a failure counts as


class Composer(Protocol):
    """Learns which latent to choose. Episode 0 of every round is to be played without exploration."""

    def choose(self, features: Array) -> Array:
        """Latents for features, (N, f) to (N, d)."""

    def learn(self, reward: Array, features: Array, terminated: Array) -> None:
        """What the choice led to: reward (N,), features (N, f), and whether a simulation failed, (N,) bool."""

    def improve(self, valid: Array) -> dict[str, float]:
        """Between two rounds: learn from it; (T, N) tells which choices still counted. Returns what is worth logging.

        Raises:
            SkillError: learning came apart.
        """

    def arrays(self) -> dict[str, Array]:
        """Every weight by its name."""


class Episodes:
    """See `Planner`. Plays rounds of N episodes and keeps the best plan that a composer found without exploring.

    Args:
        row: (S,) the start state.
        points: (L, 3) m, the landmarks there.
        observation: (o,) there.
        route: where to go.
        composer: learns.
        num: N, episodes side by side.
        steps: control steps of a segment.
        segments: T, in an episode.
        rounds: of episodes, at most.
        good_enough: m, learning ends once an episode without exploration ends this close to the last waypoint.
        reward_scale: 1/m.
    """

    def __init__(
        self, row: Array, points: Array, observation: Array, route: Route, composer: Composer, num: int, steps: int,
        segments: int, rounds: int, good_enough: float, reward_scale: float,
    ) -> None:  # fmt: skip
        self._route, self._composer, self._steps, self._segments = route, composer, steps, segments
        self._rounds, self._good_enough, self._scale = rounds, good_enough, reward_scale
        self._start = np.tile(row, (num, 1)), np.tile(points, (num, 1, 1)), np.tile(observation, (num, 1))
        self.curves: dict[str, list[float]] = {}
        self.best = (np.inf, np.inf)  # waypoints missed and metres left at the end of the best episode
        self.weights: dict[str, Array] = {}  # of the composer that played it
        self._best_plan: list[Segment] = []
        self._round = self._control_steps = 0
        self._begin()

    def _begin(self) -> None:
        self._rows, points, observation = self._start
        num = len(self._rows)
        self._due, self._failed = np.zeros(num, dtype=int), np.zeros(num, dtype=bool)
        self._return: Array = np.zeros(num)
        self._features = features_of(self._route, self._due, points, observation)
        self._chosen: list[Array] = []
        self._valid: list[Array] = []

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        return self._round >= self._rounds or (self.best[0] == 0 and self.best[1] <= self._good_enough)

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        near = f"{self.best[1]:.3f} m to the goal at best" if self._best_plan else ""
        return self._round, self._rounds, near

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self._best_plan

    def ask(self) -> Proposal:
        """See `Planner`."""
        self._chosen.append(self._composer.choose(self._features))
        return Proposal(self._rows, self._chosen[-1], self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        self._control_steps += int((~self._failed).sum()) * self._steps
        self._valid.append(~self._failed)
        self._due = self._route.follow(self._due, outcome.path).due
        failed = outcome.failed & ~self._failed
        self._failed |= outcome.failed
        # a broken state is neither looked at nor stepped again
        state = outcome.rows, outcome.path[:, -1], outcome.observation
        self._rows, points, observation = (
            np.where(self._failed.reshape(-1, *(1,) * (now.ndim - 1)), start, now)
            for start, now in zip(self._start, state, strict=True)
        )
        reward = -self._scale * np.where(failed, FAILED, self._route.left(self._due, points))
        self._features = features_of(self._route, self._due, points, observation)
        self._composer.learn(reward, self._features, failed)
        self._return += np.where(self._valid[-1], reward, 0.0)
        if len(self._chosen) == self._segments:
            self._end(points)

    def _end(self, points: Array) -> None:
        """A round is over: keep the plan of episode 0 where it is the best so far, and let the composer learn."""
        missed = len(self._route.waypoints) - 1 - int(self._due[0])
        gap = float(self._route.final_gap(points)[0])
        ended = (float(missed), gap) if not self._failed[0] else (np.inf, np.inf)
        if ended < self.best:
            self.best, self.weights = ended, self._composer.arrays()
            self._best_plan = [Segment(latent[0].astype(float), -1, "latent", self._steps) for latent in self._chosen]
        self._round += 1
        point = {
            "env_steps": float(self._control_steps),
            "return": float(self._return[1:].mean()),
            "greedy_return": float(self._return[0]),
            "greedy_final_distance": gap,
            **self._composer.improve(np.stack(self._valid)),
        }
        for name, number in point.items():
            self.curves.setdefault(name, []).append(number)
        self._begin()


def features_of(route: Route, due: Array, points: Array, observation: Array) -> Array:
    """What a composer sees: (n,), (n, L, 3) and (n, o) to (n, o + 3 L)."""
    return np.concatenate([observation, route.gap(due, points).reshape(len(points), -1)], axis=1)
