"""Composed pushes sent blindly and replanned, on the same robots and goals: is looking ever worse than not looking?

    python -m studies.replanning --robot=one.toml --robot=two.toml --episodes=4

Every goal is planned once, in the simulation of the source. Episode by episode both ways then meet the same robot of a domain.
The interval of the paired difference is Tango's score interval (Tango 1998), which holds where few pairs differ; p is that of
McNemar's exact test.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from skillcli import metrics
from skillcli.composition.plan import schedule
from skillcli.composition.registry import method_spec
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.planning import problem_of
from skillcli.evaluation.replanning import Replanner
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.evaluation.transfer_evaluator import TargetRobots, TransferEvaluator
from skillcli.recipe import Recipe, resolve
from skillcli.robots.robot import load_target
from skillcli.simulation.domains import find_domain
from skillcli.store import Store
from skillcli.tasks.world import place_goal
from skillcli.trajectories import Array, Trajectories

GOALS = ("0.1,0.1", "0.1,-0.1", "-0.1,0.1", "-0.1,-0.1", "0.2,0.1", "-0.2,0.1", "0.2,-0.1", "-0.2,-0.1", "0.0,0.2", "0.2,0.0")
PROCESSES = 2


@dataclass(frozen=True)
class Setting:
    """What all jobs share."""

    store: str
    source: str
    domain: str
    episodes: int
    seed: int


def opened(setting: Setting, goal: str) -> tuple[Library, Recipe, Array]:
    """The library, how to plan with it, and where a goal is, (1, 3) m, from how it is typed."""
    store = Store(Path(setting.store))
    library = open_library(store, store.read(store.resolve(setting.source)))
    recipe = resolve(library.source.recipe, ["transfer.replan=true"])
    place = np.array([place_goal(recipe.task, [float(x) for x in goal.split(",")])])
    return library, recipe, place


def plan(setting: Setting, goal: str) -> tuple[Array, Array]:
    """Latents (T, d) and skills (T,) of the composed plan."""
    library, recipe, place = opened(setting, goal)
    problem = problem_of(library, recipe, "search", place, SampledRobots.of(recipe.compose, "", 0, library.world.joints))
    return schedule(method_spec("search").plan(problem).segments)


def rollout(setting: Setting, robot: str, goal: str, planned: tuple[Array, Array]) -> tuple[Trajectories, Trajectories, float]:
    """Both ways on the same robots: sent blindly, replanned; and seconds per plan."""
    (library, recipe, place), (latent, skill) = opened(setting, goal), planned
    script = EpisodeSchedule(latent[None], skill[None], np.array([len(skill)]), (place,)).in_turn(setting.episodes)
    target = TargetRobots.drawn(find_domain(setting.domain), setting.episodes, setting.seed, library.world.joints)
    world = library.world
    stands = world.on(load_target(Path(robot), world.robot)) if robot else world
    replanner = Replanner(library, recipe, "search")
    blind = TransferEvaluator(library, setting.seed, stands).run(script, target)
    return blind, TransferEvaluator(library, setting.seed, stands, replanner).run(script, target), replanner.effort.mean or 0.0


def mcnemar(only_a: int, only_b: int) -> float:
    """Two-sided exact p of a paired difference from the pairs in which only one succeeds."""
    n, k = only_a + only_b, min(only_a, only_b)
    return min(1.0, 2 * sum(math.comb(n, i) for i in range(k + 1)) / 2**n)


def paired_interval(only_a: int, only_b: int, pairs: int, z: float = 1.959964) -> tuple[float, float]:
    """Tango's score interval of the difference of two paired rates, a - b."""

    def score(delta: float) -> float:
        a = 2 * pairs
        b = -only_a - only_b + (2 * pairs - only_a + only_b) * delta
        c = -only_b * delta * (1 - delta)
        q = (math.sqrt(max(0.0, b * b - 4 * a * c)) - b) / (2 * a)  # of the pairs in which only b succeeds, constrained
        variance = pairs * (2 * q + delta * (1 - delta))
        return (only_a - only_b - pairs * delta) / math.sqrt(max(variance, 1e-12))

    estimate = (only_a - only_b) / pairs
    return _where(lambda d: score(d) - z, -1.0, estimate), _where(lambda d: score(d) + z, estimate, 1.0)


def _where(falls: Callable[[float], float], low: float, high: float) -> float:
    """Where a falling function is zero, by bisection."""
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if falls(middle) > 0 else (low, middle)
    return (low + high) / 2


def row(name: str, recording: Trajectories) -> str:
    """Success with Wilson's interval, distances, and episodes that break a limit of the box."""
    met, episodes = int(recording.success.sum()), recording.episodes
    low, high = metrics.wilson_interval(met, episodes)
    distance, beyond = 100 * metrics.final_distance(recording), recording.violation_steps
    broken = ", ".join(f"{limit} {int((beyond[limit] > 0).sum())}" for limit in ("box_tipped", "box_pressed"))
    return (
        f"{name}: {met} of {episodes} ({low:.0%}-{high:.0%}), median {np.median(distance):.1f} cm, "
        f"farthest {distance.max():.1f} cm, {broken}"
    )


def compared(blind: Trajectories, again: Trajectories) -> str:
    """The paired difference of success, replanned minus blindly."""
    won, lost = int((again.success & ~blind.success).sum()), int((blind.success & ~again.success).sum())
    low, high = paired_interval(won, lost, blind.episodes)
    p = mcnemar(won, lost)
    difference = (won - lost) / blind.episodes
    return f"replanned - blindly: {difference:+.0%} ({low:+.0%} to {high:+.0%}), won {won}, lost {lost}, p {p:.2g}"


def _told(where: str, pairs: Sequence[tuple[Trajectories, Trajectories]]) -> None:
    blind, again = (Trajectories.join(list(way)) for way in zip(*pairs, strict=True))
    print(f"{where}\n  {row('blindly', blind)}\n  {row('replanned', again)}\n  {compared(blind, again)}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", default="artifacts")
    parser.add_argument("--id", default="reference-push-robust/embed-means")
    parser.add_argument("--goal", action="append", help="by default ten of them")
    parser.add_argument(
        "--robot", action="append", help="a robot file, or nothing behind = for the source, which is the default"
    )
    parser.add_argument("--domain", default="real-like")
    parser.add_argument("--episodes", type=int, default=10, help="of each goal on each robot")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    setting = Setting(given.store, given.id, given.domain, given.episodes, given.seed)
    goals, robots = given.goal or GOALS, given.robot or [""]
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        plans = dict(zip(goals, pool.map(plan, [setting] * len(goals), goals), strict=True))
        jobs = list(product(goals, robots))
        played = pool.map(
            rollout, [setting] * len(jobs), *([*each] for each in zip(*[(r, g, plans[g]) for g, r in jobs], strict=True))
        )
        found: dict[str, list[tuple[Trajectories, Trajectories]]] = {robot: [] for robot in robots}
        for (goal, robot), (blind, again, seconds) in zip(jobs, played, strict=True):
            found[robot].append((blind, again))
            _told(f"{robot or 'source'} to {goal}, {seconds:.2f} s per plan", [(blind, again)])
    for robot, pairs in found.items():
        _told(f"--- {robot or 'source'}, {setting.domain}", pairs)
    _told("--- all", [pair for pairs in found.values() for pair in pairs])


if __name__ == "__main__":
    main()
