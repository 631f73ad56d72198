"""Search over a set of latents: uniform cost, A* or greedy (see `uniform_cost`)."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from pydantic import model_validator

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.method import MethodSettings, MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.composition.plan import Choices, Segment, latent_grid
from skillcli.composition.planner import Proposal
from skillcli.composition.uniform_cost import Node, SearchSetup, UniformCostSearch
from skillcli.config.base import value
from skillcli.errors import UsageError
from skillcli.trajectories import Array

MAX_GRID = 1024  # most latents on the grid of a search


class SearchSettings(MethodSettings):
    """Settings of the uniform cost search over latents."""

    segments: tuple[float, ...] = value((0.25,), "how long one latent may be held", "s", min_length=1)
    interpolated: bool = value(False, "offer the half-way latents of all pairs of skills beside the means")
    grid: int = value(
        0,
        "offer a grid of this many latents per dimension, over the box of the means +- 2 std, beside the means",
        "",
        ge=0,
        le=32,
    )
    resolution: float = value(0.02, "two states closer than this count as one", "m", ge=1e-4, le=10)
    goal_tolerance: float = value(0.02, "a waypoint counts as met within this; the task's tolerance is the judge", "m", gt=0)
    max_speed: float = value(
        2.0, "no faster motion of the judged point is thought possible; gives the heuristic, 0 for none", "m/s", ge=0
    )
    approach_speed: float = value(
        0.0, "speed of the gripper on its way behind the box, for the heuristic of push; 0 leaves that out", "m/s", ge=0
    )
    weight: float = value(
        1.0, "weight of the heuristic: 0 uniform cost, 1 A*, above 1 faster to find, up to that much longer", "", ge=0
    )
    final_speed: float = value(0.0, "the last goal counts as met only at or below this speed; 0 for any", "m/s", ge=0)
    batch: int = value(32, "nodes that are expanded at once", "nodes", ge=1, le=4096)
    budget: int = value(5_000, "expanded nodes after which the best plan so far is taken", "nodes", ge=1)

    @model_validator(mode="after")
    def _positive(self) -> SearchSettings:
        if any(not 0 < s <= 60 for s in self.segments):
            raise ValueError("every segment must last between 0 and 60 seconds")
        return self

    def check_latents(self, size: int) -> None:
        """Refuse a grid with too many latents."""
        if self.grid**size > MAX_GRID:
            raise ValueError(
                f"search.grid of {self.grid} gives {self.grid**size} latents in {size} dimensions,"
                f" at most {MAX_GRID} can be offered"
            )


class Expansions:
    """A search as a `Planner`: it expands several nodes at once, with every choice and every duration.

    A longer segment continues where a shorter one ended: every control step is simulated once.
    """

    def __init__(self, search: UniformCostSearch, batch: int) -> None:
        self.search, self._batch = search, batch
        self._durations = sorted(search.settings.durations)
        self._left: list[int] = []  # durations that the nodes in work still have to try
        self._held = 0
        self.replayed = 0.0  # control steps to return to the nodes tried, once per try: a robot cannot restore a state

    def _begin(self, nodes: list[Node]) -> None:
        count = len(self.search.choices.latent)
        self._parents = [node for node in nodes for _ in range(count)]
        self._choice: Array = np.tile(np.arange(count), len(nodes))
        self._sim_states = np.stack([node.sim_state for node in self._parents])
        robots, *shape = self.search.best.keypoints.shape
        self._path: Array = np.empty((len(self._parents), robots, 0, *shape))
        self._failed: Array = np.zeros((len(self._parents), robots), dtype=bool)
        self._left, self._held = list(self._durations), 0
        self.replayed += sum(node.cost for node in self._parents)

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        return not self._left and self.search.finished

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        return self.search.expanded, self.search.settings.budget, self.search.standing

    def plan(self) -> list[Segment]:
        """See `Planner`: the way to the goal node, or to the nearest node when the budget is spent."""
        return self.search.plan(self.search.best)

    @property
    def remaining_length(self) -> float:
        """Length of the straight way through the waypoints that the best plan leaves, with the last one's tolerance, m."""
        return self.search.remaining_length(self.search.best)

    @property
    def next_place(self) -> Array:
        """Return the achieved goal after the first segment of the best plan, (3,) m, mean over the robots."""
        node = self.search.best
        while node.parent is not None and node.parent.parent is not None:
            node = node.parent
        place: Array = node.keypoints[:, 0].mean(axis=0)
        return place

    def ask(self) -> Proposal:
        """See `Planner`."""
        if not self._left:
            self._begin(self.search.ask(self._batch))
        return Proposal(self._sim_states, self.search.choices.latent[self._choice], self._left[0] - self._held)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        self._path = np.concatenate([self._path[:, :, :-1] if self._held else self._path, outcome.path], axis=2)
        self._failed |= outcome.failed
        self._sim_states, self._held = outcome.sim_states, self._left.pop(0)
        so_far = Outcome(self._path, self._failed, self._sim_states)
        self.search.tell(self._parents, self._choice, so_far, self._held)


def choices_of(problem: PlanningProblem) -> Choices:
    """Return the latents that a search tries."""
    settings = problem.settings_as(SearchSettings)
    grid = latent_grid(problem.bounds[0], problem.bounds[1], settings.grid) if settings.grid else None
    places = problem.goal_map.hull.inside(np.array(problem.aims)) if problem.mixtures and problem.aims else ()
    named = [("map({:.3f},{:.3f},{:.3f})".format(*place), problem.goal_map.latents(place[None])[0]) for place in places]
    return Choices.of(problem.mean, problem.names, settings.interpolated, grid, list(dict(named).items()))


def search_from(
    problem: PlanningProblem, sim_state: Array, keypoints: Array, waypoints: Array, choices: Choices, budget: int,
    barred: Collection[int] = (), begun: int = 0,
) -> UniformCostSearch:  # fmt: skip
    """Make a search from a state (S,) with keypoints (M, L, 3) m, after `begun` control steps, to waypoints (W, 3) m."""
    settings = problem.settings_as(SearchSettings)
    return UniformCostSearch(
        sim_state,
        keypoints,
        waypoints,
        choices,
        SearchSetup(
            durations=tuple(sorted({problem.steps(seconds) for seconds in settings.segments})),
            tolerance=min(settings.goal_tolerance, problem.tolerance),
            resolution=settings.resolution,
            step_seconds=problem.period,
            weight=settings.weight,
            max_speed=settings.max_speed,
            approach_speed=settings.approach_speed,
            cost_to_go=problem.cost_to_go,
            final_speed=settings.final_speed or float("inf"),
            budget=budget,
        ),
        barred,
        begun,
    )


def plan(problem: PlanningProblem) -> PlanResult:
    """Find the cheapest plan within the budget."""
    settings, choices = problem.settings_as(SearchSettings), choices_of(problem)
    world = problem.make_world(settings.batch * len(choices.latent))
    state, segments, expanded, replayed = world.start(), list[Segment](), 0, 0.0
    for number, leg in enumerate(problem.legs, 1):
        search = search_from(problem, *state, leg, choices, settings.budget, begun=sum(each.steps for each in segments))
        planner = Expansions(search, settings.batch)
        problem.run(planner, world, "nodes")
        expanded, replayed = expanded + search.expanded, replayed + planner.replayed
        segments += planner.plan()
        if number < len(problem.legs):
            state = world.follow(state, planner.plan())
    if not segments:  # already there, or no waypoint: hold the first skill for the shortest time
        segments = [Segment(choices.latent[0], 0, choices.label[0], min(map(problem.steps, settings.segments)))]
    scale = problem.robots * problem.period
    return PlanResult(segments, expanded, world.control_steps * problem.period, replayed * scale)


HEURISTICS = {
    "none": ("search.weight=0",),
    "distance": ("search.approach_speed=0",),
    "approach": ("search.approach_speed=1.0",),
}


def heuristic_overrides(name: str) -> Sequence[str]:
    """Convert a heuristic's name to recipe settings.

    Raises:
        UsageError: no heuristic has this name.
    """
    if name not in HEURISTICS:
        raise UsageError(f"no heuristic {name!r}", f"heuristics: {', '.join(HEURISTICS)}")
    return HEURISTICS[name]


METHOD = MethodSpec(
    name="search",
    settings=SearchSettings,
    plan=plan,
    hint="try --set search.budget=50000 or search.interpolated=true",
    options=(
        Option("heuristic", "Estimate of the remaining time: none, distance, approach.", "NAME", overrides=heuristic_overrides),
        Option("weight", "Weight of the heuristic: 0 uniform cost, 1 A*, 1000 greedy best-first.", "W", float),
    ),
    ensemble=True,
    on_target=True,
    replans=True,
    # On a target, planning time is robot time: expand one node at a time, greedily, over the means, with a coarse goal.
    overrides_on_target=(
        "search.batch=1", "search.weight=1000", "search.interpolated=false", "search.grid=0", "search.goal_tolerance=0.035",
    ),
)  # fmt: skip
