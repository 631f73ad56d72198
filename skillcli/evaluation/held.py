"""Hold one latent from the start to the end of each episode."""

from __future__ import annotations

import numpy as np

from skillcli.evaluation.rollouts import rollout
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.learning.agent import Agent
from skillcli.seeding import generator
from skillcli.simulation.environment import NO_SKILL
from skillcli.tasks.world import MAX_SIMULATIONS, World
from skillcli.trajectories import Array, Trajectories


def rollout_held(
    world: World, agent: Agent, latent: Array, target: Array, skill: Array, threads: int = 0, start: Array | None = None,
    robots: SampledRobots | None = None,
) -> tuple[Trajectories, Array]:  # fmt: skip
    """Hold one latent (E, d) per episode from start to end; success is measured at its target (E, 3) m.

    Episodes begin where these skills `start` (E,) do, by default where the task does, on the nominal robot or each on one of E
    `robots`.

    Returns:
        The recording, with the skills (E,), and the observations (E, T+1, o).
    """
    recordings, observations = [], []
    for first in range(0, len(skill), MAX_SIMULATIONS):
        part = slice(first, first + MAX_SIMULATIONS)
        begin = np.full(len(skill[part]), NO_SKILL) if start is None else start[part]
        parameters = {} if robots is None else {name: values[part] for name, values in robots.parameters.items()}
        env = world.make_randomized_env(begin, parameters, generator(robots.seed if robots else 0, "sensors"), threads)
        env.desired_goal[:] = target[part]
        held = np.repeat(latent[part][:, None], env.horizon, axis=1)
        recording, observation = rollout(env, agent.act, held, np.repeat(skill[part][:, None], env.horizon, axis=1))
        recordings.append(recording)
        observations.append(observation)
    return Trajectories.join(recordings), np.concatenate(observations)
