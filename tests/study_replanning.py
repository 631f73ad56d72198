"""Composed plans sent blindly and replanned, on the same robots and goals: is looking ever worse than not looking?

    python -m tests.study_replanning --goal=0.1,0.1 --goal=-0.1,0.1 --robot=arm.toml --episodes=10

Every goal is planned once, in the simulation of the source. Each robot file, beside the source itself, then stands for every
episode of every domain, with parameters drawn alike for both ways. Intervals are Wilson's for each way, and Tango's for the
paired difference (Tango 1998), which holds where only few pairs differ; the p is that of McNemar's exact test.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from skillcli import metrics
from skillcli.composition.plan import schedule
from skillcli.envs.domains import find_domain
from skillcli.envs.robot import load_robot
from skillcli.envs.tasks import goal_place
from skillcli.recipe import resolve
from skillcli.stages.library import open_library
from skillcli.stages.planning import METHODS, Leg
from skillcli.stages.replanning import Replanner
from skillcli.stages.robots import Robots
from skillcli.stages.script import Script
from skillcli.stages.trial import Target, Trial
from skillcli.store import Store
from skillcli.trajectories import Trajectories

GOALS = ("0.1,0.1", "0.1,-0.1", "-0.1,0.1", "-0.1,-0.1", "0.2,0.1", "-0.2,0.1", "0.2,-0.1", "-0.2,-0.1", "0.0,0.2", "0.2,0.0")
PROCESSES = 2


@dataclass(frozen=True)
class Job:
    """One goal on one robot in one domain."""

    store: str
    source: str
    goal: str
    robot: str  # a file, empty for the source
    domain: str
    episodes: int
    seed: int
    settings: tuple[str, ...]


@dataclass(frozen=True)
class Way:
    """What the episodes of one way came to, each (E,)."""

    success: list[bool]
    distance: list[float]  # m
    tipped: list[bool]
    pressed: list[bool]
    seconds: list[float]

    @staticmethod
    def of(recording: Trajectories) -> Way:
        """From a recording."""
        beyond = recording.beyond_limits
        return Way(
            recording.success.tolist(),
            metrics.final_distance(recording).tolist(),
            (beyond["box_tipped"] > 0).tolist(),
            (beyond["box_pressed"] > 0).tolist(),
            (recording.length * (recording.time[1] - recording.time[0])).tolist(),
        )


@dataclass(frozen=True)
class Pair:
    """A job, both ways."""

    job: Job
    blind: Way
    replanned: Way
    seconds_per_plan: float | None


def play(job: Job) -> Pair:
    """Plan a goal, and send and replan the plan on the same robots."""
    store = Store(Path(job.store))
    library = open_library(store, store.read(store.resolve(job.source)))
    recipe = resolve(library.source.recipe, [*job.settings, "transfer.replan=true"])
    goal = np.array([goal_place(recipe.task, [float(x) for x in job.goal.split(",")])])
    settings = recipe.compose
    leg = Leg(library, recipe, goal, (), 0, lambda _: None, Robots.of(settings, "", 0))
    latent, skill = schedule(METHODS["search"](leg).segments)
    script = Script(latent[None], skill[None], np.array([len(skill)]), (goal,)).in_turn(job.episodes)
    robot = load_robot(Path(job.robot)) if job.robot else None
    target = Target.drawn(find_domain(job.domain), job.episodes, job.seed)
    replanner = Replanner(leg, "search")
    again = Trial(library, job.seed, robot, replanner).run(script, target)
    sent = Trial(library, job.seed, robot).run(script, target)
    return Pair(job, Way.of(sent), Way.of(again), replanner.effort.mean)


def _one_core(cores: list[int]) -> None:
    os.sched_setaffinity(0, {cores[os.getpid() % len(cores)]})


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", default="artifacts")
    parser.add_argument("--id", default="reference-push-robust/embed-means")
    parser.add_argument("--goal", action="append")
    parser.add_argument("--robot", action="append", default=[], help="a robot file; '' for the source")
    parser.add_argument("--domain", action="append")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--out")
    given = parser.parse_args()
    print(given)


if __name__ == "__main__":
    main()
