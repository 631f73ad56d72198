"""How well does `skill identify` recover robots of `real-like` from ten seconds of a plan?"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.transfer_evaluator import TargetRobots
from skillcli.execution.identify.identify import identify
from skillcli.execution.log import Log, checked
from skillcli.seeding import generator
from skillcli.simulation.domains import find_domain
from skillcli.store import Artifact, Store

ROBOTS, STEPS, NEAR = 20, 200, 0.15


def logs(library: Library, artifact: Artifact, seed: int, increments: bool) -> tuple[list[Log], TargetRobots]:
    """What the sensors of each robot say while it plays a plan again and again."""
    world, plan = library.world, EpisodeSchedule.of(artifact, library)
    target = TargetRobots.drawn(find_domain("real-like"), ROBOTS, seed, world.joints, "identify")
    rngs = [generator(seed, f"identify sensors {robot}") for robot in range(ROBOTS)]
    env = world.make_randomized_env(np.zeros(ROBOTS, dtype=np.int64), target.parameters, rngs, 1)
    rows, starts, steps, episode = [], [], 0, 0
    while steps + int(plan.steps[episode % plan.episodes]) <= STEPS:
        env.reset(np.arange(ROBOTS), np.zeros(ROBOTS, dtype=np.int64))
        observation, which = env.observe(), episode % plan.episodes
        starts.append(len(rows))
        for step in range(int(plan.steps[which])):
            measured = observation[:, : world.joints].astype(float)
            observation = env.step(library.agent.act(observation, np.tile(plan.latent[which, step], (ROBOTS, 1)))).observation
            commanded = env.arms.commanded.copy()
            rows.append((measured, env.applied.copy() if increments else commanded, world.task.control_period * step))
        last = observation[:, : world.joints].astype(float)
        rows.append((last, 0 * commanded if increments else commanded, world.task.control_period * int(plan.steps[which])))
        steps, episode = steps + int(plan.steps[which]), episode + 1
    names = world.robot.description.joints
    stamps = np.array([stamp for _, _, stamp in rows])
    return [
        checked(
            Log(
                names,
                stamps,
                np.array([row[0][robot] for row in rows]),
                np.array([row[1][robot] for row in rows]),
                increments,
                tuple(starts),
            ),
            f"robot {robot}",
        )
        for robot in range(ROBOTS)
    ], target


def main() -> None:
    """Identify every robot, and count how many latencies and gains are right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", default="reference-reach/compose-v1")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--increments", action="store_true", help="log increments instead of targets")
    parser.add_argument("--threads", type=int, default=0)
    args = parser.parse_args()
    store = Store(Path("artifacts"))
    artifact = store.read(store.resolve(args.source, ()))
    library = open_library(store, artifact)
    world = library.world
    recorded, target = logs(library, artifact, args.seed, args.increments)
    late, near, held = 0, [], []
    for index, log in enumerate(recorded):
        found = identify(log, world.robot, world.task.action_scale, threads=args.threads)
        gain, true = found.parameters["gain"], target.parameters["gain"][index]
        late += abs(float(found.parameters["latency"].value) - target.parameters["latency"][index]) < 1e-9
        near.append(np.abs(gain.value / true - 1) <= NEAR)
        held.append((gain.low <= true) & (true <= gain.high))
        print(index, found.meaning, np.round(gain.value / true - 1, 3), found.half_second, flush=True)
    print(f"latency right {late} of {len(recorded)}; gains within 15 % {np.mean(near):.3f}, by joint {np.mean(near, axis=0)}")
    print(f"true gain within the interval {np.mean(held):.3f}")


if __name__ == "__main__":
    main()
