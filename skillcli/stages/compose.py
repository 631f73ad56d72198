"""Stage 2: compose frozen skills in the latent space into a task that was never trained."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skillcli import metrics
from skillcli.composition.method import Finding, PlanResult
from skillcli.composition.plan import Plan, Segment, schedule
from skillcli.composition.registry import METHODS, method_spec
from skillcli.evaluation.inputs import compose_inputs, robots_for
from skillcli.evaluation.library import Library, check_untouched, open_library
from skillcli.evaluation.planning import problem_of
from skillcli.evaluation.prediction import predict
from skillcli.evaluation.request import Request
from skillcli.evaluation.rollouts import rollout_waypoints
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.evaluation.violations import locate_violations
from skillcli.kinds import COMPOSE
from skillcli.kinds.compose import GOALS, ComposeMeasured, ComposeResults, Waypoint
from skillcli.kinds.record import point
from skillcli.progress import OnProgress, Progress, silent
from skillcli.recipe import Recipe
from skillcli.simulation.domains import find_domain
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Array, Trajectories

__all__ = ["Request", "compose", "execute"]


def compose(
    store: Store,
    source_id: ArtifactId,
    recipe: Recipe,
    request: Request,
    method: str,
    command: str,
    name: str | None = None,
    on_progress: OnProgress = silent,
    seed: int = 0,
    on: str = "",
) -> Artifact:
    """Plan latents that meet the waypoints, execute the plan where it was planned, and write a compose artifact.

    A plan that violates a safety limit there has failed. How often it succeeds when it is sent blindly is predicted on robots
    that are drawn from the domain `compose.robots`.

    Args:
        store: to read from and write to.
        source_id: an embed-means or pretrain artifact.
        recipe: how to plan; the skills come from the source.
        request: waypoints to meet.
        method: name of the method.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        on_progress: called with the progress of planning.
        seed: of random methods, and of drawn robots.
        on: a domain, to plan and execute on one robot drawn from it; empty for the nominal simulation.

    Raises:
        UsageError: the method is unknown, or the recipe asks for other skills than the source holds.
        SkillError: training of a composer diverged.
        StoreError: the source cannot be read, or the store refuses.
    """
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library = open_library(store, source)
    return store.write(draft_of(library, source, recipe, request, method, command, name, on_progress, seed, on))


def draft_of(
    library: Library,
    source: Artifact,
    recipe: Recipe,
    request: Request,
    method: str,
    command: str,
    name: str | None = None,
    on_progress: OnProgress = silent,
    seed: int = 0,
    on: str = "",
) -> Draft:
    """Plan and execute as `compose` does, and return what it writes.

    Args:
        library: the skills of the source.
        source: an embed-means or pretrain artifact.
        recipe: see `compose`, as for all others.
        request: waypoints to meet.
        method: name of the method.
        command: for the record.
        name: first part of the new id.
        on_progress: called with the progress of planning.
        seed: of random methods, and of drawn robots.
        on: a domain to plan on.

    Raises:
        UsageError: see `compose`.
        SkillError: see `compose`.
    """
    spec = method_spec(method)
    library = library.in_scene(recipe.task)
    check_untouched(library, recipe, f"{', '.join(f'{section}.*' for section in METHODS)}, task.tolerance and compose.*")
    robots = robots_for(recipe, library.world, method, on, seed)
    others = find_domain(recipe.compose.robots)
    started = time.perf_counter()
    by_hand = request.entries or ((),) * len(request.routes)
    problems = [
        problem_of(library, recipe, method, waypoints, robots, entries, seed, _within(on_progress, done, len(request.routes)))
        for done, (waypoints, entries) in enumerate(zip(request.routes, by_hand, strict=True))
    ]
    planned = [spec.plan(problem) for problem in problems]
    finding = spec.examine(problems[0]) if spec.examine else Finding({}, {}, 0.0)
    planning_seconds = time.perf_counter() - started
    plan = Plan(tuple(tuple(found.segments) for found in planned))
    judge = robots if on else SampledRobots()
    recordings = [
        execute(library, route, waypoints, judge) for route, waypoints in zip(plan.routes, request.routes, strict=True)
    ]
    recording = Trajectories.join(recordings)
    met, broken = recording.success, locate_violations(plan, recording)
    recording = recording.with_success(met & recording.within_limits)  # a planner can avoid a violation, so one is a failure
    tolerance = recipe.task.tolerance
    closest = [
        metrics.ordered_approach(path, waypoints, tolerance)
        for path, waypoints in zip(recording.achieved_goal, request.routes, strict=True)
    ]
    return Draft(
        kind=COMPOSE.name,
        name=name or source.id.name,
        seed=seed if spec.draws or robots.parameters else source.seed,
        command=command,
        recipe=recipe.model_dump(mode="json"),
        arrays={
            **plan.arrays(recipe.task.control_period),
            **_composer_arrays(planned),
            **finding.arrays,
            **{f"robots/{parameter}": values for parameter, values in robots.parameters.items()},
            "waypoints/target": request.waypoints,
            "waypoints/closest": np.concatenate(closest),
            "waypoints/route": request.route,
            **recording.stored(),
        },
        results=replace(
            _results(recipe, request, method, plan, planned, recording, np.concatenate(closest), finding),
            waypoints_met=bool(met.all()),
            violations=_violations(recording),
            broken=broken,
            on=on,
            robots=robots.count,
            predicted=predict(library, plan, request.routes, others),
            notes=tuple(dict.fromkeys(note for found in planned for note in found.notes)) or None,
            **finding.results,
        ).json(),
        measured=ComposeMeasured(planning_seconds=planning_seconds).json(),
        parents=[source.id],
        model_sha256=library.world.fingerprint,
        inputs_sha256=compose_inputs(source, recipe, library.world, request, method, seed, on),
    )


def _within(on_progress: OnProgress, done: int, total: int) -> OnProgress:
    """Report the progress of one route as part of all of them."""
    if total == 1:
        return on_progress

    def on_route_progress(progress: Progress) -> None:
        on_progress(Progress(progress.stage, done, total, "routes", note=f"{progress.done} {progress.unit}, {progress.note}"))

    return on_route_progress


def execute(library: Library, route: Sequence[Segment], waypoints: Array, robots: SampledRobots) -> Trajectories:
    """Execute the plan of one route from the start on one robot."""
    env = robots.make_env(library.world, 1)
    latent, skill = schedule(route)
    return rollout_waypoints(env, library.agent.act, latent[None], skill[None], [waypoints])


def _violations(recording: Trajectories) -> dict[str, int]:
    """Count the control steps that violate each limit, over all routes."""
    return {limit: int(steps.sum()) for limit, steps in recording.violation_steps.items() if steps.any()}


def _composer_arrays(planned: list[PlanResult]) -> dict[str, Array]:
    """Collect weights and learning curves of each route's composer; only several routes get names."""
    arrays: dict[str, Array] = {}
    for route, found in enumerate(planned):
        below = f"route-{route + 1}/" if len(planned) > 1 else ""
        arrays |= {f"composer/{below}{name}": array for name, array in found.weights.items()}
        arrays |= {f"curves/{below}{name}": array for name, array in found.curves.items()}
    return arrays


def _results(
    recipe: Recipe,
    request: Request,
    method: str,
    plan: Plan,
    planned: list[PlanResult],
    recording: Trajectories,
    closest: Array,
    finding: Finding,
) -> ComposeResults:
    period = recipe.task.control_period
    distance, turned = metrics.final_distance(recording), metrics.final_yaw(recording)
    return ComposeResults(
        method=method,
        task=request.task or GOALS,
        success=bool(recording.success.all()),
        success_rate=float(recording.success.mean()),
        routes=len(plan.routes),
        expanded_nodes=sum(found.expanded_nodes for found in planned),
        simulated_robot_seconds=sum(found.simulated_robot_seconds for found in planned) + finding.simulated_robot_seconds,
        robot_seconds_with_returns=sum(found.with_returns for found in planned),
        plan_seconds=plan.steps * period,
        segments=plan.records(period),
        waypoints=tuple(
            Waypoint(target=point(target), closest_m=float(near), route=int(route))
            for target, near, route in zip(request.waypoints, closest, request.route, strict=True)
        ),
        final_distance_m=float(distance.max()),
        final_distances_m=tuple(distance.tolist()),
        final_yaws_deg=None if turned is None else tuple(turned.tolist()),
    )
