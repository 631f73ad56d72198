"""How the methods compare, as a study of its own: `python -m studies.composers --help`.

Runs every method on the same unseen goals and prints a table.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from skillcli import metrics
from skillcli.composition.method import PlanResult
from skillcli.composition.registry import method_spec
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.planning import problem_of
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.recipe import resolve
from skillcli.seeding import generator
from skillcli.stages.compose import execute
from skillcli.store import Store
from skillcli.tasks.world import place_goal
from skillcli.trajectories import Array

CORNERS = {  # where unseen goals are drawn, as they are typed
    "point": ((-2.5, -2.5), (2.5, 2.5)),
    "reach": ((0.5, -0.3, 0.15), (0.7, 0.3, 0.3)),  # the cuboid of the skills
    "push": ((-0.2, -0.2), (0.2, 0.2)),
}


def unseen_goals(library: Library, count: int) -> Array:
    """The same goals for every method, (count, 3) m."""
    task = library.recipe.task
    drawn = generator(0, "unseen goals").uniform(*CORNERS[task.name], (count, len(CORNERS[task.name][0])))
    return np.array([place_goal(task, goal) for goal in drawn])


def plan(library: Library, method: str, goal: Array, settings: list[str], seed: int) -> PlanResult:
    recipe = resolve(library.source.recipe, settings)
    return method_spec(method).plan(problem_of(library, recipe, method, goal[None], SampledRobots(), seed=seed))


def methods(library: Library, names: list[str], goals: Array, settings: list[str]) -> Iterator[str]:
    """Lines of a table: success, planning time (wall, and of all cores), time spent on the robot, length of the plan."""
    yield "| method | goals | ≤ 2 cm | ≤ 5 cm | median final | planning s (CPU s) | robot s | plan s | faster than it moves |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for name in names:
        rows = []
        for goal in goals:
            wall, cpu = time.perf_counter(), time.process_time()
            planned = plan(library, name, goal, settings, 0)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            recording = execute(library, planned.segments, goal[None], SampledRobots())
            lasts = float(recording.time[-1])
            rows.append((metrics.final_distance(recording)[0], wall, cpu, planned.simulated_robot_seconds, lasts, wall < lasts))
        end, wall_s, cpu_s, robot, lasts_s, faster = np.array(rows, dtype=float).T
        yield (
            f"| {name} | {len(rows)} | {(end <= 0.02).mean():.0%} | {(end <= 0.05).mean():.0%} | {100 * np.median(end):.1f} cm "
            f"| {np.median(wall_s):.2f} ({np.median(cpu_s):.2f}) | {np.median(robot):.0f} | {np.median(lasts_s):.2f} "
            f"| {faster.mean():.0%} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=Path("artifacts"))
    parser.add_argument("--id", default="reference-reach/embed-means")
    parser.add_argument("--method", action="append", help="by default search, mpc, ppo, ddpg")
    parser.add_argument("--goals", type=int, default=20)
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    given = parser.parse_args()
    store = Store(given.store)
    library = open_library(store, store.read(store.resolve(given.id)))
    goals = unseen_goals(library, given.goals)
    for line in methods(library, given.method or ["search", "mpc", "ppo", "ddpg"], goals, given.settings):
        print(line, flush=True)


if __name__ == "__main__":
    main()
