"""How fast collecting, training and Gymnasium environments go against the bare engine; speed of `skill --help`; memory.

    python -m tests.bench [ITERATIONS]

Everything is measured in turns in one process, so that a machine which slows down slows both sides of each ratio.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from skillcli.learning.learner import Learner
from skillcli.recipe import load_recipe
from skillcli.simulation.throughput import BareEngine
from skillcli.stages.pretrain import peak_memory_mb
from skillcli.tasks.world import World

# Of reach for every bundled arm.
RECIPES = "reach", "reach-ur5e", "reach-panda", "reach-so101"
ENVIRONMENTS = "skill/Reach-v0", "skill/ReachGoal-v0", "skill/Push-v0"
STARTS = 7  # of each program

EMPTY_PROGRAM = """
import typer
app = typer.Typer()
@app.command()
def nothing() -> None: ...
app()
"""


def throughput(name: str, iterations: int) -> dict[str, float]:
    """Control steps per second of some iterations: the bare engine, while collecting, and over the whole training."""
    recipe = load_recipe(name)
    env = World.of(recipe).make_env(recipe.training.simulations)
    learner = Learner(env, recipe, seed=0)
    learner.iterate()  # first calls are slow everywhere
    bare = BareEngine(env)
    steps, sampling = learner.env_steps, learner.sampling_seconds
    training = 0.0
    for _ in range(iterations):
        bare.watch()
        began = time.perf_counter()
        learner.iterate()
        training += time.perf_counter() - began
        bare.measure()
    assert bare.rate is not None
    steps = learner.env_steps - steps
    return {
        "bare engine": bare.rate,
        "collecting": steps / (learner.sampling_seconds - sampling),
        "whole training": steps / training,
    }


def gymnasium_ratio(name: str, episodes: int = 5) -> float:
    """Time of a step of 256 Gymnasium environments, resets included, over that of the bare engine in the same states."""
    import gymnasium

    import skillcli.gym  # noqa: F401

    envs = gymnasium.make_vec(name, num_envs=256)
    batch = envs.unwrapped.episodes.env  # type: ignore[attr-defined]
    bare, rng, spent, steps = BareEngine(batch), np.random.default_rng(0), 0.0, 0
    envs.reset(seed=0)
    for episode in range(episodes + 1):
        if episode:  # first calls are slow everywhere
            bare.watch()
        for _ in range(batch.horizon + 1):
            actions = rng.uniform(-1, 1, envs.action_space.shape)
            began = time.perf_counter()
            envs.step(actions)
            spent, steps = (spent + time.perf_counter() - began, steps + 256) if episode else (0.0, 0)
        bare.measure()
    assert bare.rate is not None
    return spent / steps * bare.rate


def single_rate(name: str, steps: int = 3000) -> float:
    """Control steps per second of one Gymnasium environment with random actions, resets included."""
    import gymnasium

    import skillcli.gym  # noqa: F401

    env = gymnasium.make(name)
    env.reset(seed=0)
    began = time.perf_counter()
    for _ in range(steps):
        if any(env.step(env.action_space.sample())[2:4]):
            env.reset()
    return steps / (time.perf_counter() - began)


def start_seconds(command: list[str]) -> float:
    """Median time of a program from start to end."""
    taken = []
    for _ in range(STARTS):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def main() -> None:
    """Measure and print."""
    iterations = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    table = Table("what", "measured", "ratio", "wanted")
    wanted = {"bare engine": "", "collecting": "≥ 0.9", "whole training": "≥ 0.7"}
    for recipe in RECIPES:
        rates = throughput(recipe, iterations)
        for name, rate in rates.items():
            ratio = rate / rates["bare engine"]
            table.add_row(f"{recipe}: {name}", f"{rate:,.0f} control steps/s", f"{ratio:.2f}", wanted[name])
    for name in ENVIRONMENTS:
        table.add_row(f"gymnasium.make_vec, {name}", "256 environments", f"{gymnasium_ratio(name):.2f}", "≤ 1.15")
    table.add_row(f"gymnasium.make, {ENVIRONMENTS[0]}", f"{single_rate(ENVIRONMENTS[0]):,.0f} control steps/s", "", "≥ 3,000")
    memory = peak_memory_mb()
    empty = start_seconds([sys.executable, "-c", EMPTY_PROGRAM, "--help"])
    skill = start_seconds([str(Path(sys.executable).parent / "skill"), "--help"])
    table.add_row("empty typer program", f"{empty:.2f} s", "1.00", "")
    table.add_row("skill --help", f"{skill:.2f} s", f"{skill / empty:.2f}", "≤ 3")
    table.add_row("peak memory of them all", f"{memory:,.0f} MB", "", "< 1000 MB")
    Console().print(table)


if __name__ == "__main__":
    main()
