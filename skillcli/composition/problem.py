"""What a method is given, a `PlanningProblem`, and what it gives back, a `PlanResult`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Planner
from skillcli.composition.planner import run as run_planner
from skillcli.composition.route import STRAIGHT, CostToGo, Route
from skillcli.config.base import Section
from skillcli.progress import OnProgress, Progress, silent
from skillcli.trajectories import Array

if TYPE_CHECKING:
    from skillcli.composition.sequence import Entry


class MethodSettings(Section):
    """What a recipe may say about a method, in the section of its name."""

    def check_latents(self, size: int) -> None:
        """Refuse settings that cannot go with latents of this size.

        Raises:
            ValueError: they cannot.
        """


Settings = TypeVar("Settings", bound=MethodSettings)


@dataclass(frozen=True)
class PlanningProblem:
    """One route, and the frozen skills that shall go it; K skills with latents of size d."""

    settings: MethodSettings  # of the method
    names: tuple[str, ...]  # of the skills
    mean: Array  # (K, d) latents of the skills
    std: Array  # (K, d)
    goals: Array  # (K, 3) m, where the skills lead
    waypoints: Array  # (W, 3) m, to be met in order
    tolerance: float  # m, within which the task counts a waypoint as met
    period: float  # s, of one control step
    horizon: int  # control steps of an episode
    make_world: Callable[[int], LatentEnvironment]  # room for that many latents to be held at once, at the start
    hold_to_end: Callable[[Array, Array], Array]  # latents (n, d) and targets (n, 3) m to where held latents end, (n, 3) m
    cost_to_go: CostToGo = STRAIGHT
    entries: tuple[Entry, ...] = ()  # of a plan that is written by hand
    robots: int = 1  # that every latent is tried on
    seed: int = 0
    on_progress: OnProgress = silent

    @property
    def bounds(self) -> Array:
        """Lowest and highest latent, (2, d): the means and two standard deviations around them."""
        return np.stack([(self.mean - 2 * self.std).min(axis=0), (self.mean + 2 * self.std).max(axis=0)])

    @property
    def route(self) -> Route:
        """Where to go."""
        return self.towards(self.waypoints)

    def towards(self, waypoints: Array) -> Route:
        """The way through these waypoints (W, 3) m."""
        return Route(waypoints, self.tolerance, self.cost_to_go)

    def settings_as(self, kind: type[Settings]) -> Settings:
        """The settings, which are of this kind."""
        assert isinstance(self.settings, kind)
        return self.settings

    def steps(self, seconds: float) -> int:
        """A duration in control steps, at least one."""
        return max(1, round(seconds / self.period))

    def segments(self, seconds: float, steps: int) -> int:
        """How many segments of some control steps fit into so many seconds for each waypoint, at least one."""
        return max(1, round(seconds * len(self.waypoints) / (steps * self.period)))

    def run(self, planner: Planner, world: LatentEnvironment, unit: str) -> None:
        """Let a planner try latents until it is finished, and report how many units of its work are done."""
        run_planner(
            planner, world, lambda done, total, note: self.on_progress(Progress("compose", done, total, unit, note=note))
        )


@dataclass(frozen=True)
class PlanResult:
    """The plan of one route, and what planning it took."""

    segments: list[Segment]
    expanded_nodes: int = 0  # states whose continuations were tried; for methods that draw latents, latents tried
    simulated_robot_seconds: float = 0.0
    replayed_seconds: float = 0.0  # that a robot would spend on top, to get back to the states that latents were tried from
    weights: dict[str, Array] = field(default_factory=dict)  # of a learned composer
    curves: dict[str, Array] = field(default_factory=dict)

    @property
    def with_returns(self) -> float:
        """Robot time where states cannot be restored, s: every try begins at the start. The way there is not counted."""
        return self.simulated_robot_seconds + self.replayed_seconds
