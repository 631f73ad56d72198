"""Sample episodes with the stochastic policy, one latent per episode, from chained or single starts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch

from skillcli.learning import gaussian
from skillcli.learning.agent import Actor, Agent
from skillcli.learning.mixtures import MIXED, UNMIXED, Mixer
from skillcli.learning.ring_buffer import RingBuffer
from skillcli.learning.worst import WorstEpisodes
from skillcli.trajectories import Array


class VectorEnvironment(Protocol):
    """What training needs of N simulations of a task."""

    num_envs: int
    joints: int  # of the arm
    horizon: int
    observation_size: int
    action_size: int
    privileged_size: int
    goals: Array
    desired_goal: Array

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Names of the terms of the reward."""

    def achieved_goal(self) -> Array:
        """Return the achieved goals, (N, 3) m."""

    def reset(self, ids: Array, skill: Array) -> None:
        """Put these simulations at the start, with the goals of these skills."""

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """Put these simulations into saved states, with the goals of these skills."""

    def mix_goals(self, ids: Array, weights: Array) -> None:
        """Give these simulations (n,) mixtures of the goals with these weights (n, K)."""

    def observe(self) -> Array:
        """Return observations (N, o)."""

    def privileged(self) -> Array:
        """Return observations for the value function only, (N, p)."""

    def step(self, action: Array) -> Any:
        """Apply one control step; returns observation, reward, terminated, truncated, reward_terms."""

    def randomize(self, parameters: Mapping[str, Array], rng: np.random.Generator) -> None:
        """Give every simulation parameters of its own."""

    def save(self, ids: Array) -> Array:
        """Return whole states of these simulations."""


@dataclass(frozen=True)
class Rollout:
    """One episode per simulation, T steps each; steps after a termination are not valid."""

    observation: Array  # (T+1, N, o) float32
    privileged: Array  # (T+1, N, p) float32
    action: Array  # (T, N, a) float32, as drawn
    log_prob: Array  # (T, N) float32 of the actions under the policy that drew them, nat
    reward: Array  # (T, N) of the task
    reward_terms: dict[str, float]  # each term of it, summed over an episode, mean over the episodes
    terminated: Array  # (T, N) bool
    valid: Array  # (T, N) bool
    skill: Array  # (N,), `MIXED` for a mixture
    weights: Array  # (N, K) float32 of the skills, one-hot without mixture
    noise: Array  # (N, d) the epsilon of z = mean + std * epsilon
    latent: Array  # (N, d)
    final_distance: Array  # (N,) m, of achieved and desired goal at the end
    repeated: Array  # (N,) bool, episodes that repeat one of the worst
    seconds: float  # wall time, including resets and drawing of noise


WAY_SIZE = 4  # offset to the goal, x y z m, and its length


def privileged_size(env: VectorEnvironment, sees_goal: bool) -> int:
    """Return how many numbers `privileged` says of each simulation, p."""
    return env.privileged_size + WAY_SIZE * sees_goal


def privileged(env: VectorEnvironment, sees_goal: bool) -> Array:
    """Return what the value function alone observes, (N, p): what the task shows it, and maybe the way to the goal.

    The way is the offset to the desired goal, (3,) m, and its length: most of what the return depends on. A value function
    needs many iterations to learn them from skill and state; until then its errors make the advantages mostly noise.
    """
    shown = env.privileged()
    if not sees_goal:
        return shown
    way = env.desired_goal - env.achieved_goal()
    return np.concatenate([shown, way, np.linalg.norm(way, axis=1, keepdims=True)], axis=1).astype(np.float32)


class StartPool(RingBuffer):
    """States passed in earlier rollouts, to start new episodes from."""

    SNAPSHOTS = 4  # states kept of each rollout

    @property
    def sim_states(self) -> Array | None:
        """Return the states (capacity, S), None if the pool is empty."""
        return self.columns[0] if self.columns else None

    @sim_states.setter
    def sim_states(self, sim_states: Array | None) -> None:
        self.columns = () if sim_states is None else (sim_states,)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Sample states (count, S) with replacement; the pool must not be empty."""
        return self.sample(count, rng)[0]


def distribute(num_envs: int, odds: Array, rng: np.random.Generator) -> Array:
    """Give every simulation a skill; return the skills (N,), each as often as its odds (K,) say, rounded up or down.

    Even odds draw the numbers that trainings have always drawn.
    """
    if (odds == odds[0]).all():
        first = rng.integers(len(odds))  # rotate the remainder so that no skill is systematically under-sampled
        return rng.permutation((np.arange(num_envs) + first) % len(odds))
    upper = np.cumsum(odds / odds.sum())[:-1]
    return rng.permutation(np.searchsorted(upper, (np.arange(num_envs) + rng.random()) / num_envs, side="right"))


def start_episodes(
    env: VectorEnvironment, pool: StartPool, chained: float, rng: np.random.Generator, odds: Array | None = None
) -> Array:
    """Give every simulation a skill, with these odds (K,) or even ones, and a start; return the skills (N,)."""
    skills = distribute(env.num_envs, np.ones(len(env.goals)) if odds is None else odds, rng)
    continued = rng.random(env.num_envs) < chained if pool.filled else np.zeros(env.num_envs, dtype=bool)
    fresh, kept = np.flatnonzero(~continued), np.flatnonzero(continued)
    if len(fresh):
        env.reset(fresh, skills[fresh])
    if len(kept):
        env.reset_to_state(kept, pool.draw(len(kept), rng), skills[kept])
    return skills


def _repeat(
    env: VectorEnvironment, worst: WorstEpisodes, ids: Array, rng: np.random.Generator, asked: Array, skill: Array,
    weights: Array,
) -> None:  # fmt: skip
    """Let these simulations begin again where a bad episode did; changes skills (N,), before and after mixing, and weights."""
    if not len(ids):
        return
    sim_states, asked[ids], weights[ids] = worst.draw(len(ids), rng)
    skill[ids] = np.where(weights[ids].max(axis=1) < 1, MIXED, asked[ids])
    env.reset_to_state(ids, sim_states, asked[ids])


@torch.no_grad()
def collect(
    env: VectorEnvironment,
    agent: Agent,
    pool: StartPool,
    chained: float,
    rng: np.random.Generator,
    mixer: Mixer = UNMIXED,
    sees_goal: bool = False,
    odds: Array | None = None,
    worst: WorstEpisodes | None = None,
    repeat: float = 0.0,
) -> Rollout:
    """Run one episode in every simulation, and keep some of the passed states for later starts.

    Args:
        env: N simulations.
        agent: acts.
        pool: of passed states.
        chained: share of the episodes that begin in one of these.
        rng: of skills, latents, starts and exploration.
        mixer: makes mixtures of some skills.
        sees_goal: whether the value function observes the way to the goal.
        odds: of the skills, (K,), None if they are even.
        worst: episodes that can be repeated, of earlier rollouts and then of this one; None to keep none.
        repeat: share of the episodes that repeat one of them.
    """
    started = time.perf_counter()
    steps, num_envs = env.horizon, env.num_envs
    asked = start_episodes(env, pool, chained, rng, odds)
    skill, weights = mixer.mix(asked, agent.skills, rng)
    repeated = np.zeros(num_envs, dtype=bool)
    if worst is not None and worst.filled:
        repeated = rng.random(num_envs) < repeat
        _repeat(env, worst, np.flatnonzero(repeated), rng, asked, skill, weights)
    begun = env.save(np.arange(num_envs)) if worst is not None else np.zeros(0)
    if (mixed := np.flatnonzero(skill == MIXED)).size:
        env.mix_goals(mixed, weights[mixed])
    mean, std = agent.embed()
    noise = rng.standard_normal((num_envs, mean.shape[1]))
    latent = (weights @ mean + (weights @ std) * noise).astype(np.float32)
    exploration = agent.policy.std.numpy() * rng.standard_normal((steps, num_envs, env.action_size), dtype=np.float32)
    kept_moments = set(rng.choice(steps, size=min(pool.SNAPSHOTS, steps), replace=False).tolist())

    observation = np.empty((steps + 1, num_envs, env.observation_size), dtype=np.float32)
    privileged_observation = np.empty((steps + 1, num_envs, privileged_size(env, sees_goal)), dtype=np.float32)
    action = np.empty((steps, num_envs, env.action_size), dtype=np.float32)
    reward = np.empty((steps, num_envs), dtype=np.float32)
    terminated, valid = np.zeros((steps, num_envs), dtype=bool), np.ones((steps, num_envs), dtype=bool)
    everyone = np.arange(num_envs)
    alive = np.ones(num_envs, dtype=bool)
    terms = dict.fromkeys(env.reward_names, 0.0)
    act = Actor(agent, latent)

    observation[0], privileged_observation[0] = env.observe(), privileged(env, sees_goal)
    for t in range(steps):
        np.add(act(observation[t]), exploration[t], out=action[t])
        step = env.step(action[t])
        observation[t + 1], reward[t], terminated[t], valid[t] = step.observation, step.reward, step.terminated, alive
        privileged_observation[t + 1] = privileged(env, sees_goal)
        alive &= ~step.terminated
        for name, values in step.reward_terms.items():
            terms[name] += float(values @ alive)
        if t in kept_moments:
            pool.add(env.save(everyone[alive]))  # no episode starts from a failed one
    final_distance = np.where(alive, np.linalg.norm(env.achieved_goal() - env.desired_goal, axis=1), np.inf)
    if worst is not None:
        worst.keep(begun, asked, weights, final_distance)
    seconds = time.perf_counter() - started
    return Rollout(
        observation=observation,
        privileged=privileged_observation,
        action=action,
        log_prob=gaussian.log_prob(torch.from_numpy(exploration), torch.zeros(()), agent.policy.std).numpy(),
        reward=reward,
        reward_terms={name: total / num_envs for name, total in terms.items()},
        terminated=terminated,
        valid=valid,
        skill=skill,
        weights=weights.astype(np.float32),
        noise=noise.astype(np.float32),
        latent=latent,
        final_distance=final_distance,
        repeated=repeated,
        seconds=seconds,
    )
