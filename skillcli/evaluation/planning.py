"""How each method plans one route: its planner is built from recipe and library, and let loose on the simulator."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from skillcli.composition.episodes import Composer, Episodes
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.mpc import ModelPredictiveControl
from skillcli.composition.plan import Choices, Segment, latent_grid
from skillcli.composition.planner import run
from skillcli.composition.route import Route
from skillcli.composition.search import Expansions, Settings, UniformCostSearch
from skillcli.composition.sequence import Entry
from skillcli.composition.settings import Episodes as EpisodeSettings
from skillcli.errors import SkillError
from skillcli.evaluation.library import Library
from skillcli.evaluation.sampled_robots import Robots
from skillcli.learning.ddpg import DdpgComposer
from skillcli.learning.ppo import PpoComposer
from skillcli.progress import Progress, Report
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.tasks.registry import half_edges
from skillcli.tasks.world import MAX_SIMULATIONS
from skillcli.trajectories import SAFETY_LIMITS, Array


@dataclass(frozen=True)
class Planned:
    """The plan of one route, and what planning it took."""

    segments: list[Segment]
    expanded_nodes: int  # states whose continuations were tried; for methods that draw latents, latents tried
    simulated_robot_seconds: float
    replayed_seconds: float = 0.0  # that a robot would spend on top, to get back to the states that latents were tried from
    weights: dict[str, Array] = field(default_factory=dict)  # of a learned composer
    curves: dict[str, Array] = field(default_factory=dict)

    @property
    def with_returns(self) -> float:
        """Robot time where states cannot be restored, s: every try begins at the start. The way there is not counted."""
        return self.simulated_robot_seconds + self.replayed_seconds


@dataclass(frozen=True)
class Leg:
    """One route of a request, as a method plans it."""

    library: Library
    recipe: Recipe
    waypoints: Array  # (W, 3) m
    entries: tuple[Entry, ...]  # of a plan that is written by hand, else none
    seed: int
    report: Report
    robots: Robots  # that latents are tried on

    @property
    def period(self) -> float:
        """Control period, s."""
        return float(self.recipe.task.control_period)

    @property
    def box(self) -> Array:
        """Lowest and highest latent, (2, d): the means and two standard deviations around them."""
        mean, std = self.library.mean, self.library.std
        return np.stack([(mean - 2 * std).min(axis=0), (mean + 2 * std).max(axis=0)])

    @property
    def route(self) -> Route:
        """Where to go."""
        return self.towards(self.waypoints)

    def towards(self, waypoints: Array) -> Route:
        """The way through these waypoints (W, 3) m."""
        return Route(waypoints, self.recipe.task.tolerance, half_edges(self.recipe.task))

    def steps(self, seconds: float) -> int:
        """A duration in control steps, at least one."""
        return max(1, round(seconds / self.period))

    def world(self, slots: int) -> LatentEnvironment:
        """Room for this many latents to be held at once, at the start, unless memory bounds it."""
        count = self.robots.count
        env = self.robots.simulations(self.library.world, min(max(1, MAX_SIMULATIONS // count), slots))
        return LatentEnvironment(env, self.library.agent.act, count, SAFETY_LIMITS)

    def tell(self, unit: str) -> Callable[[int, int, str], None]:
        """What a planner tells, as progress of the stage."""
        return lambda done, total, note: self.report(Progress("compose", done, total, unit, note=note))


class Method(Protocol):
    """Plans one route."""

    def __call__(self, leg: Leg) -> Planned:
        """The plan of this route."""


def by_hand(leg: Leg) -> Planned:
    """A plan that was written down already."""
    return Planned([entry.segment(leg.library.mean, leg.period) for entry in leg.entries], 0, 0.0)


def choices_of(leg: Leg) -> Choices:
    """The latents that a search tries."""
    settings = leg.recipe.search
    grid = latent_grid(leg.box[0], leg.box[1], settings.grid) if settings.grid else None
    return Choices.of(leg.library.mean, leg.library.names, settings.interpolated, grid)


def search_from(
    leg: Leg, row: Array, points: Array, waypoints: Array, choices: Choices, budget: int, barred: Collection[int] = ()
) -> UniformCostSearch:
    """A search from a state (S,) with landmarks (M, L, 3) m to waypoints (W, 3) m."""
    settings = leg.recipe.search
    return UniformCostSearch(
        row,
        points,
        waypoints,
        choices,
        Settings(
            durations=tuple(sorted({leg.steps(seconds) for seconds in settings.segments})),
            tolerance=min(settings.goal_tolerance, leg.recipe.task.tolerance),
            resolution=settings.resolution,
            step_seconds=leg.period,
            weight=settings.weight,
            max_speed=settings.max_speed,
            approach_speed=settings.approach_speed if any(half_edges(leg.recipe.task)) else 0.0,
            half_edges=half_edges(leg.recipe.task),
            final_speed=settings.final_speed or float("inf"),
            budget=budget,
        ),
        barred,
    )


def by_search(leg: Leg) -> Planned:
    """Uniform cost search and its informed relatives."""
    settings, choices = leg.recipe.search, choices_of(leg)
    world = leg.world(settings.batch * len(choices.latent))
    search = search_from(leg, *world.start(), leg.waypoints, choices, settings.budget)
    planner = Expansions(search, settings.batch)
    run(planner, world, leg.tell("nodes"))
    plan = planner.plan()
    if not plan:  # already there, or nowhere to go: hold the first skill for the shortest time
        plan = [Segment(choices.latent[0], 0, choices.label[0], search.settings.durations[0])]
    spent, replayed = world.control_steps * leg.period, planner.replayed * leg.robots.count * leg.period
    return Planned(plan, search.expanded, spent, replayed)


def mpc_from(
    leg: Leg, row: Array, points: Array, waypoints: Array, longest: int, rng: np.random.Generator
) -> ModelPredictiveControl:
    """Model predictive control from a state (S,) with landmarks (M, L, 3) m to waypoints, for some segments at most."""
    settings, steps = leg.recipe.mpc, leg.steps(leg.recipe.mpc.segment)
    route, mean = leg.towards(waypoints), leg.library.mean
    return ModelPredictiveControl(row, points, route, mean, leg.box, settings, steps, longest, rng)


def by_mpc(leg: Leg) -> Planned:
    """Model predictive control over latents."""
    settings, world = leg.recipe.mpc, leg.world(leg.recipe.mpc.samples)
    longest = max(1, round(settings.seconds * len(leg.waypoints) / (leg.steps(settings.segment) * leg.period)))
    planner = mpc_from(leg, *world.start(), leg.waypoints, longest, generator(leg.seed, "mpc"))
    run(planner, world, leg.tell("segments"))
    plan = planner.plan() or [Segment(leg.library.mean[0], 0, leg.library.names[0], 1)]  # already there
    spent = world.control_steps * leg.period
    # every sequence of a segment, in every round, begins where the plan stood then
    before = np.cumsum([0, *(segment.steps for segment in plan[:-1])]).sum() * settings.samples * settings.rounds
    return Planned(plan, world.held, spent, float(before) * leg.robots.count * leg.period)


def by_ddpg(leg: Leg) -> Planned:
    """A composer that learns off-policy."""
    settings, names = leg.recipe.ddpg, leg.library.names
    choices = None
    if settings.latents != "continuous":
        choices = Choices.of(leg.library.mean, names, settings.latents == "interpolated").latent
    return _learned(leg, settings, lambda features: DdpgComposer(features, leg.box, choices, settings, leg.seed))


def by_ppo(leg: Leg) -> Planned:
    """A composer that learns on-policy."""
    settings = leg.recipe.ppo
    return _learned(leg, settings, lambda features: PpoComposer(features, leg.box, settings, leg.seed))


def _learned(leg: Leg, settings: EpisodeSettings, composer: Callable[[int], Composer]) -> Planned:
    steps, world = leg.steps(settings.segment), leg.world(settings.simulations)
    row, points = world.start()
    points, observation = points[0], world.observe(row)[0]
    planner = Episodes(
        row, points, observation, leg.route,
        composer(observation.size + points.size),
        num=settings.simulations,
        steps=steps,
        segments=max(1, round(settings.seconds * len(leg.waypoints) / (steps * leg.period))),
        settings=settings,
    )  # fmt: skip
    run(planner, world, leg.tell("iterations"))
    if not planner.plan():
        raise SkillError("every episode failed that the composer played without exploring", "try another --seed")
    curves = {name: np.array(values) for name, values in planner.curves.items()}
    spent = world.control_steps * leg.period
    return Planned(planner.plan(), world.held, spent, weights=planner.weights, curves=curves)


METHODS: dict[str, Method] = {
    "search": by_search,
    "interpolate": by_hand,
    "sequence": by_hand,
    "ddpg": by_ddpg,
    "ppo": by_ppo,
    "mpc": by_mpc,
}
