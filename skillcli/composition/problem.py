"""`PlanningProblem`, the input of a method, and `PlanResult`, its output."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

from skillcli.composition.latent_bounds import bounds_of
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Planner
from skillcli.composition.planner import run as run_planner
from skillcli.composition.route import STRAIGHT, CostToGo, Route
from skillcli.config.base import Section
from skillcli.hull import GoalMap
from skillcli.progress import OnProgress, Progress, silent
from skillcli.trajectories import Array

if TYPE_CHECKING:
    from skillcli.composition.sequence import Entry


class MethodSettings(Section):
    """Settings of one method: the recipe section of its name."""

    def check_latents(self, size: int) -> None:
        """Refuse settings that do not fit latents of this size.

        Raises:
            ValueError: they do not fit.
        """


Settings = TypeVar("Settings", bound=MethodSettings)


@dataclass(frozen=True)
class PlanningProblem:
    """One route, and the frozen skills to follow it with; K skills with latents of size d."""

    settings: MethodSettings  # settings of the method
    names: tuple[str, ...]  # names of the skills
    mean: Array  # (K, d) latents of the skills
    std: Array  # (K, d)
    goals: Array  # (K, 3) m, goals of the skills
    mixing: tuple[int, ...]  # indices of the skills whose goals can be mixed
    waypoints: Array  # (W, 3) m, to meet in order
    tolerance: float  # m, the task counts a waypoint as met within this
    period: float  # s, one control step
    horizon: int  # control steps of an episode
    make_world: Callable[[int], LatentEnvironment]  # room to hold that many latents at once, at the start
    hold_to_end: Callable[
        [Array, Array], Array
    ]  # latents (n, d) held for an episode and targets (n, 3) m, to its ends (n, 3) m
    cost_to_go: CostToGo = STRAIGHT
    entries: tuple[Entry, ...] = ()  # entries of a written plan
    one_by_one: bool = False  # whether each waypoint is about another object, and planned for from where the last one was met
    mixtures: bool = False  # whether mixtures of the skills were trained
    aims: tuple[Array, ...] = ()  # (3,) m, places between the goals whose latents on the map may help
    handed_over: Mapping[str, MethodSettings] = field(default_factory=dict)  # settings of methods that may plan instead
    robots: int = 1  # M, robots that try every latent
    seed: int = 0
    on_progress: OnProgress = silent

    @property
    def bounds(self) -> Array:
        """Return lowest and highest latent, (2, d): two standard deviations around all means."""
        return bounds_of(self.mean, self.std)

    @cached_property
    def goal_map(self) -> GoalMap:
        """Return the latents of places between the goals."""
        return GoalMap.of(self.goals, self.mean, self.mixing)

    @property
    def legs(self) -> list[Array]:
        """Return the waypoints to plan for at once, (W, 3) m each."""
        return list(self.waypoints[:, None]) if self.one_by_one else [self.waypoints]

    @property
    def route(self) -> Route:
        """Return the route through all waypoints."""
        return self.towards(self.waypoints)

    def towards(self, waypoints: Array) -> Route:
        """Return the route through these waypoints (W, 3) m."""
        return Route(waypoints, self.tolerance, self.cost_to_go)

    def settings_as(self, kind: type[Settings]) -> Settings:
        """Return the settings, which must be of this type."""
        assert isinstance(self.settings, kind)
        return self.settings

    def steps(self, seconds: float) -> int:
        """Convert a duration to control steps, at least one."""
        return max(1, round(seconds / self.period))

    def segments(self, seconds: float, steps: int) -> int:
        """Count the segments of some control steps that fit into so many seconds per waypoint, at least one."""
        return max(1, round(seconds * len(self.waypoints) / (steps * self.period)))

    def run(self, planner: Planner, world: LatentEnvironment, unit: str) -> None:
        """Let a planner try latents until it is finished, and report its progress."""
        run_planner(
            planner, world, lambda done, total, note: self.on_progress(Progress("compose", done, total, unit, note=note))
        )


@dataclass(frozen=True)
class PlanResult:
    """The plan of one route, and the cost of planning it."""

    segments: list[Segment]
    expanded_nodes: int = 0  # states expanded; for methods that draw latents, latents tried
    simulated_robot_seconds: float = 0.0
    replayed_seconds: float = 0.0  # robot time to return to the states that latents were tried from
    weights: dict[str, Array] = field(default_factory=dict)  # weights of a learned composer
    curves: dict[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what the user should know of the plan, a line each

    @property
    def with_returns(self) -> float:
        """Robot time if states cannot be restored, s: every try starts from the beginning. Moving back there is not counted."""
        return self.simulated_robot_seconds + self.replayed_seconds
