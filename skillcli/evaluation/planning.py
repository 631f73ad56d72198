"""Build planning problems from a library, a recipe and robots; the world of a planner is simulated here."""

from __future__ import annotations

import numpy as np

from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.method import PlanningProblem
from skillcli.composition.registry import method_spec
from skillcli.composition.route import STRAIGHT
from skillcli.composition.sequence import Entry
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.library import Library
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.progress import OnProgress, silent
from skillcli.recipe import Recipe
from skillcli.tasks.registry import cost_to_go
from skillcli.tasks.world import MAX_SIMULATIONS
from skillcli.trajectories import SAFETY_LIMITS, Array


def aims_of(library: Library, waypoints: Array) -> tuple[Array, ...]:
    """Return the places (3,) m that lead to waypoints (W, 3) m: search offers their latents where mixtures were trained."""
    world = library.world
    return tuple(aim for waypoint in waypoints for aim in world.spec.aims(world.task, waypoint))


def problem_of(
    library: Library, recipe: Recipe, method: str, waypoints: Array, robots: SampledRobots, entries: tuple[Entry, ...] = (),
    seed: int = 0, on_progress: OnProgress = silent,
) -> PlanningProblem:  # fmt: skip
    """Build the planning problem of one route.

    Args:
        library: the skills.
        recipe: settings of the planner; the skills come from the library.
        method: name of the method.
        waypoints: (W, 3) m.
        robots: on which latents are tried.
        entries: of a written plan, else empty.
        seed: of random methods.
        on_progress: called with the progress of planning.
    """
    task = recipe.task

    def make_world(slots: int) -> LatentEnvironment:
        env = robots.make_env(library.world, min(max(1, MAX_SIMULATIONS // robots.count), slots))  # memory is bounded
        return LatentEnvironment(env, library.agent.act, robots.count, SAFETY_LIMITS)

    def hold_to_end(latent: Array, target: Array) -> Array:
        recording, _ = rollout_held(library.world, library.agent, latent, target, np.full(len(latent), -1))
        end: Array = recording.achieved_goal[np.arange(recording.episodes), recording.length]
        return end

    return PlanningProblem(
        settings=recipe.settings_of(method),
        names=library.names,
        mean=library.mean,
        std=library.std,
        goals=library.goals,
        mixing=task.mixing,
        waypoints=waypoints,
        tolerance=task.tolerance,
        period=float(task.control_period),
        horizon=task.horizon,
        make_world=make_world,
        hold_to_end=hold_to_end,
        cost_to_go=cost_to_go(task) or STRAIGHT,
        entries=entries,
        one_by_one=task.one_by_one,
        mixtures=recipe.mixtures.share > 0,
        aims=aims_of(library, waypoints),
        handed_over={name: recipe.settings_of(name) for name in method_spec(method).sections[1:]},
        robots=robots.count,
        seed=seed,
        on_progress=on_progress,
    )
