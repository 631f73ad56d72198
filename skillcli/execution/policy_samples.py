"""Observations on which an exported policy is compared with the library's: played again, and drawn at random."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from skillcli.evaluation.library import Library
from skillcli.evaluation.rollouts import rollout
from skillcli.execution.policy_graph import Weights
from skillcli.execution.policy_ports import Targets
from skillcli.learning.networks import CLIP
from skillcli.seeding import generator
from skillcli.simulation.environment import NO_SKILL
from skillcli.store import Artifact
from skillcli.trajectories import Array

MOST_EPISODES = 64  # of one recording that are played again
FAR = 3 * CLIP  # standard deviations up to which observations are drawn: most of them are clipped
ASTRAY = 0.3  # rad, of a drawn target from the measured angle: further than a target may lead, so that this is tried too


@dataclass(frozen=True, eq=False)
class Samples:
    """N rows of inputs, float32."""

    observation: Array  # (N, o)
    latent: Array  # (N, d)
    commanded: Array  # (N, J) rad; J is 0 where no targets are commanded

    def __len__(self) -> int:
        """Return the number of rows, N."""
        return len(self.observation)

    @staticmethod
    def join(parts: list[Samples]) -> Samples:
        """Put rows one behind the other."""
        columns = zip(*((part.observation, part.latent, part.commanded) for part in parts), strict=True)
        return Samples(*(np.concatenate(column) for column in columns))


def recorded_samples(library: Library, artifact: Artifact, targets: Targets | None, fewest: int) -> Samples:
    """Play the recorded latents of an artifact again, then those of its library, then new ones, until there are enough rows."""
    parts: list[Samples] = []
    for latent, steps in _latents(library, artifact):
        parts.append(_play(library, latent, steps, targets))
        if sum(map(len, parts)) >= fewest:
            break
    return Samples.join(parts)


def random_samples(library: Library, weights: Weights, targets: Targets | None, count: int) -> Samples:
    """Draw rows: half of the observations within the normaliser's clip, half up to three times as far; latents in ±1."""
    rng = generator(0, "export")
    reach = np.repeat([CLIP, FAR], [count - count // 2, count // 2])[:, None]
    observation = weights.mean + reach * rng.uniform(-1, 1, (count, len(weights.mean))) / weights.scale
    latent = rng.uniform(-1, 1, (count, library.mean.shape[1]))
    measured = observation[:, targets.measured if targets is not None else slice(0)]
    commanded = measured + rng.uniform(-ASTRAY, ASTRAY, measured.shape)
    return Samples(observation.astype(np.float32), latent.astype(np.float32), commanded.astype(np.float32))


def start_sample(library: Library) -> tuple[Array, Mapping[str, Array]]:
    """Return what is observed at the start, (o,), and the recorded fields of that state."""
    env = library.world.make_env(1)
    env.reset(np.zeros(1, dtype=np.int64), np.full(1, NO_SKILL))
    observation: Array = env.observe()[0].copy()
    return observation, {name: values[0] for name, values in env.recorded_state().items()}


def _latents(library: Library, artifact: Artifact) -> Iterator[tuple[Array, Array]]:
    """Yield latents (E, T, d) and control steps (E,); those that no recording holds are held as in training."""
    for recording in {one.id: one for one in (artifact, library.source)}.values():
        latent, steps = recording.arrays["trajectories/latent"], recording.arrays["trajectories/length"]
        yield latent[:MOST_EPISODES], steps[:MOST_EPISODES]
    rng, skills, horizon = generator(0, "export latents"), len(library.mean), library.recipe.task.horizon
    while True:
        skill = rng.integers(skills, size=MOST_EPISODES)
        latent = library.mean[skill] + library.std[skill] * rng.standard_normal((MOST_EPISODES, library.mean.shape[1]))
        yield np.repeat(latent[:, None], horizon, axis=1), np.full(MOST_EPISODES, horizon)


def _play(library: Library, latent: Array, steps: Array, targets: Targets | None) -> Samples:
    """Play latents (E, T, d) from the start, for control steps (E,); return what was observed before each step."""
    episodes, last = latent.shape[:2]
    env = library.world.make_env(episodes)
    env.reset(np.arange(episodes), np.full(episodes, NO_SKILL))
    recording, observation = rollout(env, library.agent.act, latent, np.full((episodes, last), -1), steps)
    running = np.arange(last) < recording.length[:, None]  # (E, T)
    moved = np.cumsum(recording.action, axis=1) - recording.action  # before each step
    commanded = np.zeros((episodes, last, 0))
    if targets is not None:
        assert recording.joint_position is not None
        commanded = recording.joint_position[:, :1] + moved  # an arm is reset where its targets are
    rows = observation[:, :-1][running], latent[running], commanded[running]
    return Samples(*(row.astype(np.float32) for row in rows))
