"""Plans from where the arm is, by any registered method that takes goals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.method import PlanResult
from skillcli.composition.registry import METHODS, method_spec
from skillcli.evaluation.inputs import robots_for
from skillcli.evaluation.library import Library
from skillcli.evaluation.planning import problem_of
from skillcli.progress import Progress
from skillcli.tasks.world import MAX_SIMULATIONS
from skillcli.trajectories import SAFETY_LIMITS, Array


class Cancelled(Exception):
    """Nobody waits for the plan any more."""


@dataclass(frozen=True)
class Start:
    """Where a plan begins and ends."""

    state: Array  # (1, v) as `Environment.estimate_state` returns it
    goal: Array  # (3,) m


def methods() -> list[str]:
    """List the methods that plan to a goal; those that take a plan written by hand, or a file, are not among them."""
    return [name for name in METHODS if (spec := method_spec(name)).write is None and not spec.argument]


def make_plan(library: Library, method: str, start: Start, seed: int, told: Callable[[str], None]) -> PlanResult:
    """Plan on the nominal robot of the library, from a state of the arm instead of the start.

    Args:
        library: the skills.
        method: one of `methods`.
        start: see there.
        seed: of random methods.
        told: called with the progress; raises `Cancelled` to stop.

    Raises:
        SkillError: the method fails.
    """

    def on_progress(progress: Progress) -> None:
        told(
            f"{method}: {progress.done} of at most {progress.total} {progress.unit}" + (progress.note and f", {progress.note}")
        )

    recipe = library.recipe
    robots = robots_for(recipe, library.world, method, "", seed)

    def make_world(slots: int) -> LatentEnvironment:
        told(f"{method}: tries latents")
        env = robots.make_env(library.world, min(max(1, MAX_SIMULATIONS // robots.count), slots))
        env.set_estimated_state(np.arange(env.num_envs), np.repeat(start.state, env.num_envs, axis=0))
        return LatentEnvironment(env, library.agent.act, robots.count, SAFETY_LIMITS)

    problem = problem_of(library, recipe, method, start.goal[None], robots, seed=seed, on_progress=on_progress)
    return method_spec(method).plan(replace(problem, make_world=make_world))
