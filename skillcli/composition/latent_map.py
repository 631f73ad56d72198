"""The map: one latent for a goal between the trained ones, without a search.

Where mixtures of skills were trained, the latent Σ w_t mean_t leads to Σ w_t goal_t (`learning.mixtures`). So a goal is
inverted, to the weights that give it (`hull.Hull`) and to their latent. That latent is tried in the simulation, and its error
corrected. With f(a) the end of the latent that the map gives for an aim a, wanted is f(a) = goal:

    a <- a - B^-1 (f(a) - goal)        B <- B + (Δf - B Δa) Δa^T / (Δa^T Δa)

from a = goal and B = 1, which a perfect map needs no more than (Broyden 1965, Mathematics of Computation 19, his first method).
Where that latent violates a limit on one of the robots, or stays far off, aims around it are tried too: a box that must move
by a centimetre is easily tipped, and may be left two centimetres off without any risk. No map leads out of the hull of the
trained goals: beyond it search plans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skillcli.composition import search
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.method import MethodSettings, MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.composition.plan import Segment
from skillcli.composition.route import risk_adjusted
from skillcli.config.base import value
from skillcli.progress import Progress
from skillcli.seeding import generator
from skillcli.trajectories import Array

OUTSIDE = 1e-3  # m: a goal that is nearer to the hull counts as inside
LONGEST_STEP = 2.0  # of a correction, in errors: a map less than half as steep as it should be is corrected in several steps
AROUND = 24  # further aims that are tried where the best one fails on a robot, or is far off
CLOSE = 0.5  # of the tolerance: farther off is far, and within this of the best aim the further ones are
POOR = "these skills were trained without mixtures: between their goals the map is a guess"


class MapSettings(MethodSettings):
    """One latent for each goal, read off the map."""

    trials: int = value(
        8,
        f"latents held at most until one ends close enough, and {AROUND} more if none is good; 1 takes the map as it is",
        "",
        ge=1,
        le=100,
    )
    goal_tolerance: float = value(0.005, "a latent that ends this close to its goal is good enough", "m", gt=0)


@dataclass(frozen=True)
class Trial:
    """A latent that was held for an episode."""

    aim: Array  # (3,) m, where the map was asked for
    latent: Array  # (d,)
    end: Array  # (3,) m, in the mean over the robots
    failed: Array  # (M,) bool, violated a limit
    missed: bool  # ended beyond the tolerance on the first robot, which is the nominal one of an ensemble
    error: float  # m from the goal, adjusted for risk over the robots, of which those that failed are a tolerance off at least
    sim_state: Array  # (S,) at the end


class Inversion:
    """Finds the latent for one goal, from one state.

    Args:
        problem: the skills.
        world: where latents are tried.
        sim_state: (S,) at the start of the segment.
        goal: (3,) m.
    """

    def __init__(self, problem: PlanningProblem, world: LatentEnvironment, sim_state: Array, goal: Array) -> None:
        self._problem, self._world, self._sim_state, self._goal = problem, world, sim_state, goal
        self._slope = np.eye(len(goal))

    def solve(self) -> Trial:
        """Try latents until one ends close enough, or there is nothing to correct; returns the best."""
        best = self._corrected()
        if self._problem.settings_as(MapSettings).trials == 1:
            return best
        far = best.failed.any() or best.error > CLOSE * self._problem.tolerance
        return min(best, *self._around(best.aim), key=_demerit) if far else best

    def _corrected(self) -> Trial:
        """Aim at the goal and correct."""
        settings = self._problem.settings_as(MapSettings)
        best = trial = self._hold(self._goal)
        for number in range(1, settings.trials):
            if not best.failed.any() and best.error <= settings.goal_tolerance:
                break
            following = self._hold(trial.aim + self._step(trial))
            moved, ends = following.aim - trial.aim, following.end - trial.end
            if moved @ moved < 1e-12:  # on the rim of the hull, and wants to leave it
                break
            self._slope += np.outer(ends - self._slope @ moved, moved) / (moved @ moved)
            trial = following
            best = min(best, trial, key=_demerit)
            note = f"ends {best.error:.3f} m from the goal"
            self._problem.on_progress(Progress("compose", number + 1, settings.trials, "latents", note=note))
        return best

    def _around(self, aim: Array) -> list[Trial]:
        """Aim at places around another aim, on the ways from there into the hull."""
        radii = CLOSE * self._problem.tolerance * np.arange(1, AROUND + 1) / AROUND
        ways = self._problem.goal_map.hull.draw(AROUND, generator(self._problem.seed, "map")) - aim
        length = np.maximum(np.linalg.norm(ways, axis=1), 1e-12)  # a hull of one goal has no extent
        return self._hold_all(aim + ways * np.minimum(1.0, radii / length)[:, None])

    def _step(self, trial: Trial) -> Array:
        error = trial.end - self._goal
        step = -np.linalg.lstsq(self._slope, error, rcond=None)[0]
        longest = LONGEST_STEP * np.linalg.norm(error)
        shortened: Array = step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-12))
        return shortened

    def _hold(self, aim: Array) -> Trial:
        return self._hold_all(aim[None])[0]

    def _hold_all(self, aims: Array) -> list[Trial]:
        """Hold the latents of aims (n, 3) m for an episode."""
        goal_map = self._problem.goal_map
        weights = goal_map.hull.weights(aims)
        latent = weights @ goal_map.mean
        outcome = self._world.hold(np.tile(self._sim_state, (len(aims), 1)), latent, self._problem.horizon)
        ends = outcome.path[:, :, -1, 0]  # (n, M, 3)
        distance = np.linalg.norm(ends - self._goal, axis=2)
        missed = distance[:, 0] > self._problem.tolerance
        error = risk_adjusted(np.where(outcome.failed, np.maximum(distance, self._problem.tolerance), distance))
        return [
            Trial(
                weights[i] @ goal_map.goals,
                latent[i],
                ends[i].mean(axis=0),
                outcome.failed[i],
                missed[i],
                error[i],
                outcome.sim_states[i],
            )
            for i in range(len(aims))
        ]


def _demerit(trial: Trial) -> tuple[bool, bool, float]:
    """How bad it is: a plan must succeed in the simulation, and then on as many robots and as exactly as possible."""
    return bool(trial.failed[0]), trial.missed, trial.error


def plan(problem: PlanningProblem) -> PlanResult:
    """Hold one latent for each waypoint, an episode long; search plans where one is outside the hull."""
    gap = float(problem.goal_map.hull.gap(problem.waypoints).max())
    if gap > OUTSIDE:
        outside = f"a goal is {100 * gap:.1f} cm outside the hull of the trained goals, where there is no map"
        return _searched(problem, f"{outside}: search planned")
    if len(problem.mixing) < len(problem.names):
        others = ", ".join(name for skill, name in enumerate(problem.names) if skill not in problem.mixing)
        return _searched(problem, f"one latent does not do the task, for which others ({others}) may be needed: search planned")
    world = problem.make_world(1)
    segments: list[Segment] = []
    sim_state, _ = world.start()
    replayed = 0.0
    for waypoint in problem.waypoints:
        before = world.held
        trial = Inversion(problem, world, sim_state, waypoint).solve()
        replayed += (world.held - before) * len(segments) * problem.horizon * problem.robots * problem.period
        segments.append(Segment(trial.latent, -1, "map", problem.horizon))
        sim_state = trial.sim_state
    spent = world.control_steps * problem.period
    return PlanResult(segments, world.held, spent, replayed, notes=() if problem.mixtures else (POOR,))


def _searched(problem: PlanningProblem, why: str) -> PlanResult:
    """Let search plan, whose choices include the latents of the map."""
    return replace(search.plan(replace(problem, settings=problem.handed_over[search.METHOD.name])), notes=(why,))


METHOD = MethodSpec(
    name="map",
    settings=MapSettings,
    plan=plan,
    hint="more --trials correct further; a library trained with mixtures has a better map; else --method search",
    options=(
        Option(
            "trials",
            f"Latents held at most until one ends close enough, and {AROUND} more if none is good; 1 takes the map as it is.",
            "N",
            int,
        ),
    ),
    ensemble=True,
    on_target=True,
    hands_over_to=search.METHOD.name,
)
