"""A composition as a decision problem for a composer that learns: episodes from the start, an action is a latent.

What the composer sees: the observation of the robot, and the keypoints as seen from the next waypoint. What it gets
after each segment: minus the metres that were left to go, on average over its control steps. An episode is over when the
last waypoint is met or a simulation fails (termination), or when time is up (truncation).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from pydantic import model_validator

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.method import MethodSettings, PlanningProblem, PlanResult
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.route import Route
from skillcli.config.base import value
from skillcli.errors import SkillError
from skillcli.trajectories import Array

FAILED = 5.0  # metres to go that a failure counts as


class EpisodeSettings(MethodSettings):
    """The decision problem that a learned composer solves: from the start, a latent every segment."""

    segment: float = value(0.25, "how long one latent is held", "s", gt=0, le=60)
    seconds: float = value(2.0, "length of an episode, for each waypoint of the route", "s", gt=0, le=600)
    simulations: int = value(32, "episodes side by side; the first one is played without exploration", "", ge=2, le=4096)
    iterations: int = value(100, "rounds of episodes, each followed by learning", "", ge=1, le=100_000)
    goal_tolerance: float = value(0.02, "an episode, and the plan, ends within this of the last waypoint", "m", gt=0)
    good_enough: float = value(
        0.02, "learning ends once the composer without exploration ends this close to the last waypoint; 0 never", "m", ge=0
    )
    reward_scale: float = value(5.0, "factor on the reward, minus the metres left to go", "1/m", gt=0)
    discount: float = value(0.9, "gamma", "1/segment", ge=0, lt=1)
    hidden: tuple[int, ...] = value((64, 64), "hidden layers of every network", "units", min_length=1, max_length=16)

    @model_validator(mode="after")
    def _whole(self) -> EpisodeSettings:
        if self.segment > self.seconds:
            raise ValueError("a segment cannot last longer than an episode")
        if any(not 1 <= n <= 4096 for n in self.hidden):
            raise ValueError("every hidden layer needs between 1 and 4096 units")
        return self


class Composer(Protocol):
    """Learns which latent to choose. Episode 0 of every round is to be played without exploration."""

    def choose(self, features: Array) -> Array:
        """Latents for features, (N, f) to (N, d)."""

    def learn(self, reward: Array, features: Array, terminated: Array) -> None:
        """What the choice led to: reward (N,), features (N, f), and whether the episode is over for good, (N,) bool."""

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
        keypoints: (L, 3) m, there.
        observation: (o,) there.
        route: where to go.
        composer: learns.
        num: N, episodes side by side.
        steps: control steps of a segment.
        segments: T, in an episode at most.
        settings: the recipe's.
    """

    def __init__(
        self, row: Array, keypoints: Array, observation: Array, route: Route, composer: Composer, num: int, steps: int,
        segments: int, settings: EpisodeSettings,
    ) -> None:  # fmt: skip
        self._route, self._composer, self._settings = route, composer, settings
        self._steps, self._segments = steps, segments
        self._start = np.tile(row, (num, 1)), np.tile(keypoints, (num, 1, 1)), np.tile(observation, (num, 1))
        self.curves: dict[str, list[float]] = {}
        self.best: tuple[float, float, int] = (np.inf, np.inf, 0)  # waypoints missed, m from the last one, control steps
        self.weights: dict[str, Array] = {}  # of the composer that played it
        self._best_plan: list[Segment] = []
        self._round = self._control_steps = 0
        self._begin()

    def _begin(self) -> None:
        self._rows, keypoints, observation = self._start
        num = len(self._rows)
        self._next_waypoint = np.zeros(num, dtype=int)
        self._failed, self._arrived = np.zeros(num, dtype=bool), np.zeros(num, dtype=bool)
        self._return: Array = np.zeros(num)
        self._features = features_of(self._route, self._next_waypoint, keypoints, observation)
        self._chosen: list[Array] = []
        self._valid: list[Array] = []
        self._greedy: list[Segment] = []  # what episode 0 did
        self._gap = np.inf  # m, from its end to the last waypoint

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        return self._round >= self._settings.iterations or (self.best[0] == 0 and self.best[1] <= self._settings.good_enough)

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        near = f"{self.best[1]:.3f} m to the goal at best" if self._best_plan else ""
        return self._round, self._settings.iterations, near

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self._best_plan

    def ask(self) -> Proposal:
        """See `Planner`."""
        self._chosen.append(self._composer.choose(self._features))
        return Proposal(self._rows, self._chosen[-1], self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        running = ~(self._failed | self._arrived)
        progress = self._route.follow(self._next_waypoint[:, None], outcome.path, self._settings.goal_tolerance)
        broken, path = outcome.failed[:, 0], outcome.path[:, 0]  # a composer learns on one robot
        failed, arrived = broken & running, (progress.arrived > 0) & running & ~broken
        reward = -self._settings.reward_scale * np.where(failed, FAILED, progress.cost / self._steps)
        self._control_steps += int(running.sum()) * self._steps
        self._next_waypoint = np.where(running, progress.next_waypoint[:, 0], self._next_waypoint)
        self._failed |= failed
        self._arrived |= arrived
        if running[0]:
            self._follow(path[0], int(progress.arrived[0]))
        # where an episode is over, nothing is looked at or stepped again: the state may be broken
        state = outcome.rows, path[:, -1], outcome.observation[:, 0]
        over = self._failed | self._arrived
        self._rows, keypoints, observation = (
            np.where(over.reshape(-1, *(1,) * (now.ndim - 1)), start, now)
            for start, now in zip(self._start, state, strict=True)
        )
        self._features = features_of(self._route, self._next_waypoint, keypoints, observation)
        self._composer.learn(reward, self._features, failed | arrived)
        self._valid.append(running)
        self._return += np.where(running, reward, 0.0)
        if len(self._chosen) == self._segments:
            self._end()

    def _follow(self, path: Array, arrived: int) -> None:
        """Take down what episode 0 did; its plan ends the moment it arrives."""
        steps = arrived or self._steps
        self._greedy.append(Segment(self._chosen[-1][0].astype(float), -1, "latent", steps))
        self._gap = float(self._route.final_gap(path[steps]))

    def _end(self) -> None:
        """A round is over: keep the plan of episode 0 where it is the best so far, and let the composer learn."""
        missed = len(self._route.waypoints) - 1 - int(self._next_waypoint[0])
        gap = max(self._gap, self._settings.goal_tolerance if self._arrived[0] else 0.0)  # who arrives first wins, not closest
        ended = (float(missed), gap, sum(segment.steps for segment in self._greedy))
        if not self._failed[0] and ended < self.best:
            self.best, self.weights, self._best_plan = ended, self._composer.arrays(), self._greedy
        self._round += 1
        point = {
            "env_steps": float(self._control_steps),
            "return": float(self._return[1:].mean()),
            "greedy_return": float(self._return[0]),
            "greedy_final_distance": self._gap,
            "arrived": float(self._arrived.mean()),
            **self._composer.improve(np.stack(self._valid)),
        }
        for name, number in point.items():
            self.curves.setdefault(name, []).append(number)
        self._begin()


def features_of(route: Route, next_waypoint: Array, keypoints: Array, observation: Array) -> Array:
    """What a composer sees: (n,), (n, L, 3) and (n, o) to (n, o + 3 L)."""
    return np.concatenate([observation, route.gap(next_waypoint, keypoints).reshape(len(keypoints), -1)], axis=1)


def learn_to_plan(problem: PlanningProblem, make_composer: Callable[[int], Composer]) -> PlanResult:
    """Let a composer learn on one route; it is made for so many features."""
    settings = problem.settings_as(EpisodeSettings)
    steps, world = problem.steps(settings.segment), problem.make_world(settings.simulations)
    row, keypoints = world.start()
    keypoints, observation = keypoints[0], world.observe(row)[0]
    planner = Episodes(
        row, keypoints, observation, problem.route,
        make_composer(observation.size + keypoints.size),
        num=settings.simulations,
        steps=steps,
        segments=problem.segments(settings.seconds, steps),
        settings=settings,
    )  # fmt: skip
    problem.run(planner, world, "iterations")
    if not planner.plan():
        raise SkillError("every episode failed that the composer played without exploring", "try another --seed")
    curves = {name: np.array(values) for name, values in planner.curves.items()}
    return PlanResult(planner.plan(), world.held, world.control_steps * problem.period, weights=planner.weights, curves=curves)
