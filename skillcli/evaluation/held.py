"""Hold one latent from the start to the end of each episode."""

from __future__ import annotations

import numpy as np

from skillcli.evaluation.rollouts import rollout
from skillcli.learning.agent import Agent
from skillcli.simulation.environment import NO_SKILL
from skillcli.tasks.world import MAX_SIMULATIONS, World
from skillcli.trajectories import Array, Trajectories


def rollout_held(
    world: World, agent: Agent, latent: Array, target: Array, skill: Array, threads: int = 0, start: Array | None = None
) -> tuple[Trajectories, Array]:
    """Hold one latent (E, d) per episode from start to end; success is measured at its target (E, 3) m.

    Episodes begin where these skills `start` (E,) do, by default where the task does.

    Returns:
        The recording, with the skills (E,), and the observations (E, T+1, o).
    """
    recordings, observations = [], []
    for first in range(0, len(skill), MAX_SIMULATIONS):
        part = slice(first, first + MAX_SIMULATIONS)
        env = world.make_env(len(skill[part]), threads)
        env.reset(np.arange(env.num_envs), np.full(env.num_envs, NO_SKILL) if start is None else start[part])
        env.desired_goal[:] = target[part]
        held = np.repeat(latent[part][:, None], env.horizon, axis=1)
        recording, observation = rollout(env, agent.act, held, np.repeat(skill[part][:, None], env.horizon, axis=1))
        recordings.append(recording)
        observations.append(observation)
    return Trajectories.join(recordings), np.concatenate(observations)
