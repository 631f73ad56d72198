"""What the first seconds of a robot tell about it: which of many drawn robots moves most alike?

    python -m studies.identify [ID [STORE]]

Every target of a domain plays one skill. Candidates are drawn from the same domain; each is sent the same actions, open loop,
from the start as the sensors show it, and the one whose joints stay nearest to the measured ones is taken for the target.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from skillcli.config.randomization import latin_hypercube, sample
from skillcli.evaluation.library import Library, open_library
from skillcli.simulation.domains import find_domain
from skillcli.store import Store
from skillcli.trajectories import Array

TARGETS, CANDIDATES = 40, 64


def measured(library: Library, parameters: dict[str, Array], steps: int, skill: int) -> tuple[Array, Array, Array]:
    """What sensors show of targets that play a skill: sightings (E, v) at the start, joints (T, E, J) rad, actions alike."""
    env = library.world.make_env(TARGETS, delay=True)
    env.randomize(parameters, np.random.default_rng(1))
    env.reset(np.arange(TARGETS), np.full(TARGETS, skill))
    observation, seen = env.observe(), env.estimate_state().state
    latent = np.tile(library.mean[skill], (TARGETS, 1))
    joints, actions = [], []
    for _ in range(steps):
        step = env.step(library.agent.act(observation, latent))
        observation = step.observation
        joints.append(observation[:, : env.joints])
        actions.append(env.applied.copy())
    return seen, np.stack(joints), np.stack(actions)


def joint_error(library: Library, candidates: dict[str, Array], seen: Array, joints: Array, actions: Array) -> Array:
    """Root mean square distance of measured joints and those of each candidate, (E, C) rad."""
    env = library.world.make_env(CANDIDATES, delay=True)
    env.randomize({name: values for name, values in candidates.items() if not name.endswith("noise")}, np.random.default_rng(0))
    limit = library.recipe.task.action_scale
    off = np.zeros((len(seen), CANDIDATES))
    for target in range(len(seen)):
        env.set_estimated_state(np.arange(CANDIDATES), np.repeat(seen[target : target + 1], CANDIDATES, axis=0))
        for t in range(len(joints)):
            step = env.step(np.tile(actions[t, target] / limit, (CANDIDATES, 1)))
            off[target] += np.square(step.observation[:, : env.joints] - joints[t, target]).mean(axis=1)
    return np.sqrt(off / len(joints))


def main() -> None:
    """Measure and print."""
    store = Store(Path(sys.argv[2] if len(sys.argv) > 2 else "artifacts"))
    library = open_library(store, store.read(store.resolve(sys.argv[1] if len(sys.argv) > 1 else "reference-reach/pretrain")))
    ranges = find_domain("real-like").parameters
    targets = sample(ranges, TARGETS, np.random.default_rng(2), library.world.joints)
    candidates = latin_hypercube(ranges, CANDIDATES, np.random.default_rng(3), library.world.joints)
    table = Table("seen for", "latency right", "gain: r", "damping: r", "friction: r")
    for steps in (5, 10, 20, 40):
        best = joint_error(library, candidates, *measured(library, targets, steps, 0)).argmin(axis=1)
        right = (candidates["latency"][best] == targets["latency"]).mean()
        told = [
            np.corrcoef(candidates[name][best].mean(axis=1), targets[name].mean(axis=1))[0, 1]
            for name in ("gain", "joint_damping", "joint_friction")
        ]
        table.add_row(f"{steps * library.recipe.task.control_period:.2f} s", f"{right:.0%}", *(f"{r:.2f}" for r in told))
    Console().print(table)


if __name__ == "__main__":
    main()
