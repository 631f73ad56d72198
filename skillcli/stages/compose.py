"""Stage 2: compose frozen skills in the latent space into a task that was never trained."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli import metrics
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.plan import Choices, Segment, latent_grid, schedule
from skillcli.composition.search import Settings, UniformCostSearch, search
from skillcli.envs.tasks import MAX_SIMULATIONS, check_goal, goal_place, make, model_fingerprint, named_routes, standoff
from skillcli.errors import UsageError
from skillcli.learning.playback import play_waypoints
from skillcli.recipe import Recipe
from skillcli.stages.library import TRAINED, Library, fingerprint, open_library
from skillcli.stages.progress import Progress, Report, silent
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Array, Trajectories

METHODS = ("search",)


@dataclass(frozen=True)
class Request:
    """What is asked of a composition: a named task, or goals in order.

    A task has one or several routes, each planned and executed from the start, with waypoints to be met in order.
    """

    task: str  # "" where goals are given
    routes: tuple[Array, ...]  # (W, 3) m each

    @staticmethod
    def of(recipe: Recipe, task: str, goals: Sequence[Sequence[float]]) -> Request:
        """Named task or goals; where neither is given, what the recipe asks for.

        Raises:
            UsageError: both, none, an unknown name, or a goal that cannot be reached.
        """
        if task and goals:
            raise UsageError("a composition takes --task or --goal, not both", "leave one of them out")
        if not task and not goals:
            task, goals = recipe.compose.task, recipe.compose.goals
        if not task and not goals:
            raise UsageError("nothing to compose: neither --task nor --goal is given", "see `skill tasks`, or give --goal")
        routes = named_routes(recipe.task, task) if task else (np.array([goal_place(recipe.task, goal) for goal in goals]),)
        for goal in np.concatenate(routes):
            check_goal(recipe.task, goal)
        return Request(task, routes)

    @property
    def waypoints(self) -> Array:
        """The waypoints of all routes, (W, 3) m."""
        return np.concatenate(self.routes)

    @property
    def route(self) -> Array:
        """The route that each of them belongs to, (W,)."""
        return np.repeat(np.arange(len(self.routes)), [len(route) for route in self.routes])


@dataclass(frozen=True)
class Effort:
    """What planning took."""

    expanded_nodes: int
    simulated_robot_seconds: float


def inputs_of(source: Artifact, recipe: Recipe, request: Request, method: str) -> str:
    """Fingerprint of everything that the result depends on."""
    parts = [source.content_sha256, method, recipe.fingerprint(["search"]), request.task, request.waypoints, request.route]
    return fingerprint("compose", parts)


def compose(
    store: Store,
    source_id: ArtifactId,
    recipe: Recipe,
    request: Request,
    method: str,
    command: str,
    name: str | None = None,
    report: Report = silent,
) -> Artifact:
    """Plan latents that meet the waypoints, execute the plan in the source, and write a compose artifact.

    Args:
        store: where from and to.
        source_id: an embed-means or pretrain artifact.
        recipe: how to plan; the skills come from the source.
        request: what to meet.
        method: one of `METHODS`.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        report: told where the planning stands.

    Raises:
        UsageError: the method is unknown, or the recipe asks for other skills than the source holds.
        StoreError: the source cannot be read, or the store refuses.
    """
    if method not in METHODS:
        raise UsageError(f"no method {method!r}", f"methods: {', '.join(METHODS)}")
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library = open_library(store, source)
    if recipe.fingerprint(TRAINED) != library.recipe.fingerprint(TRAINED):
        raise UsageError(
            f"the skills of {source_id} were trained on another recipe than the one to compose with",
            "only search.* and compose.* can be set here; for anything else train anew",
        )
    started = time.perf_counter()
    plans, efforts = [], []
    for done, waypoints in enumerate(request.routes):
        plan, effort = _search(library, recipe, waypoints, _within(report, done, len(request.routes)))
        plans.append(plan)
        efforts.append(effort)
    planning_seconds = time.perf_counter() - started
    recordings = [execute(library, plan, waypoints) for plan, waypoints in zip(plans, request.routes, strict=True)]
    recording = Trajectories.join(recordings)
    tolerance = recipe.task.tolerance
    closest = [
        metrics.ordered_approach(path, waypoints, tolerance)
        for path, waypoints in zip(recording.judged, request.routes, strict=True)
    ]
    segments = [segment for plan in plans for segment in plan]
    return store.write(
        Draft(
            kind="compose",
            name=name or source_id.name,
            seed=source.seed,
            command=command,
            recipe=recipe.model_dump(mode="json"),
            arrays={
                "plan/latent": np.array([segment.latent for segment in segments]),
                "plan/seconds": np.array([segment.steps * recipe.task.control_period for segment in segments]),
                "plan/skill": np.array([segment.skill for segment in segments]),
                "plan/route": np.repeat(np.arange(len(plans)), [len(plan) for plan in plans]),
                "waypoints/target": request.waypoints,
                "waypoints/closest": np.concatenate(closest),
                "waypoints/route": request.route,
                **{f"trajectories/{field}": array for field, array in recording.arrays().items()},
            },
            results=_results(recipe, request, method, plans, efforts, recording, np.concatenate(closest)),
            measured={"planning_seconds": planning_seconds},
            parents=[source_id],
            model_sha256=model_fingerprint(recipe.task),
            inputs_sha256=inputs_of(source, recipe, request, method),
        )
    )


def _within(report: Report, done: int, total: int) -> Report:
    """A report of one route as part of all of them."""
    if total == 1:
        return report

    def told(progress: Progress) -> None:
        report(Progress(progress.stage, done, total, "routes", note=f"{progress.done} {progress.unit}, {progress.note}"))

    return told


def execute(library: Library, plan: list[Segment], waypoints: Array) -> Trajectories:
    """Run a plan from the start in one nominal simulation."""
    env = make(library.recipe.task, 1)
    env.reset(np.array([0]), np.array([0]))
    latent, skill = schedule(plan)
    return play_waypoints(env, library.agent.act, latent[None], skill[None], [waypoints])


def _search(library: Library, recipe: Recipe, waypoints: Array, report: Report) -> tuple[list[Segment], Effort]:
    settings, period = recipe.search, recipe.task.control_period
    corners = (library.mean - 2 * library.std).min(axis=0), (library.mean + 2 * library.std).max(axis=0)
    grid = latent_grid(*corners, settings.grid) if settings.grid else None
    choices = Choices.of(library.mean, library.names, settings.interpolated, grid)
    env = make(recipe.task, min(MAX_SIMULATIONS, settings.batch * len(choices.latent)))
    env.reset(np.arange(env.num), np.zeros(env.num, dtype=np.int64))
    world = LatentEnvironment(env, library.agent.act)
    planner = UniformCostSearch(
        *world.start(),
        waypoints,
        choices,
        Settings(
            durations=tuple(sorted({max(1, round(seconds / period)) for seconds in settings.segments})),
            tolerance=min(settings.goal_tolerance, recipe.task.tolerance),
            resolution=settings.resolution,
            step_seconds=period,
            weight=settings.weight,
            max_speed=settings.max_speed,
            approach_speed=settings.approach_speed if standoff(recipe.task) else 0.0,
            standoff=standoff(recipe.task),
            final_speed=settings.final_speed or float("inf"),
            budget=settings.budget,
        ),
    )

    def tell(expanded: int, due: int) -> None:
        report(Progress("compose", expanded, settings.budget, "nodes", note=f"{due} of {len(waypoints)} waypoints met"))

    node = search(planner, world, settings.batch, tell)
    plan = planner.plan(node)
    if not plan:  # already there, or nowhere to go: hold the first skill for the shortest time
        plan = [Segment(choices.latent[0], 0, choices.label[0], planner.settings.durations[0])]
    return plan, Effort(planner.expanded, world.control_steps * period)


def _results(
    recipe: Recipe,
    request: Request,
    method: str,
    plans: list[list[Segment]],
    efforts: list[Effort],
    recording: Trajectories,
    closest: Array,
) -> dict[str, Any]:
    period = recipe.task.control_period
    distance = metrics.final_distance(recording)
    return {
        "method": method,
        "task": request.task or "goals",
        "success": bool(recording.success.all()),
        "success_rate": float(recording.success.mean()),
        "routes": len(plans),
        "expanded_nodes": sum(effort.expanded_nodes for effort in efforts),
        "simulated_robot_seconds": sum(effort.simulated_robot_seconds for effort in efforts),
        "plan_seconds": sum(segment.steps for plan in plans for segment in plan) * period,
        "segments": [
            {
                "skill": segment.label,
                "latent": segment.latent.tolist(),
                "seconds": segment.steps * period,
                "route": route,
            }
            for route, plan in enumerate(plans)
            for segment in plan
        ],
        "waypoints": [
            {"target": target.tolist(), "closest_m": float(near), "route": int(route)}
            for target, near, route in zip(request.waypoints, closest, request.route, strict=True)
        ],
        "final_distance_m": float(distance.max()),
        "final_distances_m": distance.tolist(),
    }
