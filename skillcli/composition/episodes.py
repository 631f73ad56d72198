"""Composition as a Markov decision process for a composer that learns: an action is a latent.

The composer observes the robot's observation and the keypoints relative to the next waypoint. Its reward after each
segment is minus the mean remaining length, m, over the control steps of the segment. An episode terminates when the last
waypoint is met or the simulation fails; it is truncated when time is up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from pydantic import model_validator

from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.method import MethodSettings, PlanningProblem, PlanResult
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.route import Route
from skillcli.config.base import value
from skillcli.errors import SkillError
from skillcli.trajectories import Array

FAILED = 5.0  # m, the remaining length that a failure counts as


class EpisodeSettings(MethodSettings):
    """Settings of the decision process: the composer chooses a new latent for every segment."""

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
    """Learns which latent to choose. `Episodes` plays episode 0 of every round without exploration."""

    def act(self, features: Array) -> Array:
        """Choose latents (N, d) for features (N, f)."""

    def observe(self, reward: Array, features: Array, terminated: Array) -> None:
        """Take what the latents led to: reward (N,), features (N, f), and which episodes terminated, (N,) bool."""

    def update(self, valid: Array) -> dict[str, float]:
        """Learn from the last round and return the scalars to log.

        Args:
            valid: (T, N) bool, which choices were made before their episode was over.

        Raises:
            SkillError: learning diverged.
        """

    def arrays(self) -> dict[str, Array]:
        """Return every weight by its name."""


@dataclass(frozen=True)
class Moment:
    """The state of N episodes."""

    sim_states: Array  # (N, S) states
    keypoints: Array  # (N, L, 3) m
    observation: Array  # (N, o)

    @staticmethod
    def start(world: LatentEnvironment, num_envs: int) -> Moment:
        """Repeat the start state of a world with one robot N times."""
        sim_state, keypoints = world.start()
        observation = world.observe(sim_state)
        return Moment(
            np.tile(sim_state, (num_envs, 1)), np.tile(keypoints, (num_envs, 1, 1)), np.tile(observation, (num_envs, 1))
        )

    def unless(self, over: Array, other: Moment) -> Moment:
        """Keep this moment, but take `other` for the episodes that are over, (N,) bool."""
        return Moment(*(
            np.where(over.reshape(-1, *(1,) * (mine.ndim - 1)), theirs, mine)
            for mine, theirs in (
                (getattr(self, each.name), getattr(other, each.name)) for each in fields(self)
            )
        ))  # fmt: skip


class Round:
    """N episodes from the start. Episode 0 is played without exploration; its actions are a plan.

    Args:
        start: state of all episodes at the start.
        route: waypoints to pass.
        settings: from the recipe.
        steps: control steps of a segment.
    """

    def __init__(self, start: Moment, route: Route, settings: EpisodeSettings, steps: int) -> None:
        self._start, self._route, self._settings, self._steps = start, route, settings, steps
        num_envs = len(start.sim_states)
        self.now = start
        self.next_waypoint = np.zeros(num_envs, dtype=int)
        self.failed, self.arrived = np.zeros(num_envs, dtype=bool), np.zeros(num_envs, dtype=bool)
        self.total: Array = np.zeros(num_envs)  # sum of the rewards
        self.valid: list[Array] = []  # (N,) bool for each segment: which episodes were still running before it
        self.plan: list[Segment] = []
        self.gap = np.inf  # m, from the end of the plan to the last waypoint

    @property
    def over(self) -> Array:
        """Return which episodes are over, (N,) bool."""
        return self.failed | self.arrived

    @property
    def features(self) -> Array:
        """Return the composer's input: the observation, and the keypoints relative to the next waypoint, (N, o + 3 L)."""
        gap = self._route.gap(self.next_waypoint, self.now.keypoints)
        return np.concatenate([self.now.observation, gap.reshape(len(gap), -1)], axis=1)

    @property
    def merit(self) -> tuple[float, float, int]:
        """Return the cost of the plan, to be compared in order: waypoints missed, m from the last one, control steps."""
        missed = len(self._route.waypoints) - 1 - int(self.next_waypoint[0])
        gap = max(
            self.gap, self._settings.goal_tolerance if self.arrived[0] else 0.0
        )  # every plan that arrives has the same gap: the faster one wins
        return float(missed), gap, sum(segment.steps for segment in self.plan)

    def advance(self, latent: Array, outcome: Outcome) -> tuple[Array, Array]:
        """Record the outcome of held latents (N, d); return rewards (N,) and which episodes terminated now, (N,) bool."""
        valid = ~self.over
        progress = self._route.follow(self.next_waypoint[:, None], outcome.path, self._settings.goal_tolerance)
        broken, path = outcome.failed[:, 0], outcome.path[:, 0]  # a composer learns on one robot
        failed, arrived = broken & valid, (progress.arrived > 0) & valid & ~broken
        reward = -self._settings.reward_scale * np.where(failed, FAILED, progress.cost / self._steps)
        self.next_waypoint = np.where(valid, progress.next_waypoint[:, 0], self.next_waypoint)
        self.failed |= failed
        self.arrived |= arrived
        if valid[0]:
            steps = int(progress.arrived[0]) or self._steps  # the plan ends at the step that arrives
            self.plan.append(Segment(latent[0].astype(float), -1, "latent", steps))
            self.gap = float(self._route.final_gap(path[0, steps]))
        # an episode that is over keeps its last valid state: the simulator's may not be finite
        self.now = Moment(outcome.sim_states, path[:, -1], outcome.observation[:, 0]).unless(self.over, self._start)
        self.valid.append(valid)
        self.total += np.where(valid, reward, 0.0)
        return reward, failed | arrived


class Episodes:
    """See `Planner`. Plays rounds of N episodes and keeps the best plan that the composer found without exploration.

    Args:
        start: state of all episodes at the start.
        route: waypoints to pass.
        composer: chooses the latents and learns.
        steps: control steps of a segment.
        segments: T, the most in an episode.
        settings: from the recipe.
    """

    def __init__(
        self, start: Moment, route: Route, composer: Composer, steps: int, segments: int, settings: EpisodeSettings
    ) -> None:
        self._composer, self._settings, self._steps, self._segments = composer, settings, steps, segments
        self._begin: Callable[[], Round] = lambda: Round(start, route, settings, steps)
        self._round, self._rounds, self._control_steps = self._begin(), 0, 0
        self._latent: Array = np.zeros(0)  # (N, d) proposed last
        self._plan: list[Segment] = []
        self.merit: tuple[float, float, int] = (np.inf, np.inf, 0)  # cost of the plan, see `Round.merit`
        self.weights: dict[str, Array] = {}  # weights of the composer that made the plan
        self.curves: dict[str, list[float]] = {}

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        good_enough = self.merit[0] == 0 and self.merit[1] <= self._settings.good_enough
        return self._rounds >= self._settings.iterations or good_enough

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        near = f"{self.merit[1]:.3f} m to the goal at best" if self._plan else ""
        return self._rounds, self._settings.iterations, near

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self._plan

    def ask(self) -> Proposal:
        """See `Planner`."""
        self._latent = self._composer.act(self._round.features)
        return Proposal(self._round.now.sim_states, self._latent, self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        reward, terminated = self._round.advance(self._latent, outcome)
        self._composer.observe(reward, self._round.features, terminated)
        if len(self._round.valid) == self._segments:
            self._end(self._round)
            self._round = self._begin()

    def _end(self, played: Round) -> None:
        """Keep the plan of this round if it is the best so far, and let the composer learn."""
        if not played.failed[0] and played.merit < self.merit:
            self.merit, self.weights, self._plan = played.merit, self._composer.arrays(), played.plan
        valid = np.stack(played.valid)
        self._rounds += 1
        self._control_steps += int(valid.sum()) * self._steps
        point = {
            "env_steps": float(self._control_steps),
            "return": float(played.total[1:].mean()),
            "greedy_return": float(played.total[0]),
            "greedy_final_distance": played.gap,
            "arrived": float(played.arrived.mean()),
            **self._composer.update(valid),
        }
        for name, number in point.items():
            self.curves.setdefault(name, []).append(number)


def learn_to_plan(problem: PlanningProblem, make_composer: Callable[[int], Composer]) -> PlanResult:
    """Train a composer on one route and return its best plan.

    Args:
        problem: the route and the frozen skills.
        make_composer: makes a composer for a number of features.
    """
    settings = problem.settings_as(EpisodeSettings)
    steps, world = problem.steps(settings.segment), problem.make_world(settings.simulations)
    start = Moment.start(world, settings.simulations)
    size = start.observation[0].size + start.keypoints[0].size
    segments = problem.segments(settings.seconds, steps)
    planner = Episodes(start, problem.route, make_composer(size), steps, segments, settings)
    problem.run(planner, world, "iterations")
    if not planner.plan():
        raise SkillError("every episode that the composer played without exploration failed", "try another --seed")
    curves = {name: np.array(values) for name, values in planner.curves.items()}
    return PlanResult(planner.plan(), world.held, world.control_steps * problem.period, weights=planner.weights, curves=curves)
