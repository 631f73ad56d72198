"""Playing latents through the frozen policy, deterministic and closed loop, and recording what happens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from skillcli import metrics
from skillcli.trajectories import Array, Trajectories

Act = Callable[[Array, Array], Array]  # observations (N, o) and latents (N, d) to actions (N, a)


class RecordedEnvironment(Protocol):
    """What a recording needs of N simulations."""

    num: int
    control_period: float
    tolerance: float
    target: Array
    applied: Array

    def observe(self) -> Array:
        """Observations (N, o)."""

    def step(self, action: Array) -> Any:
        """One control step: observation, reward, terminated, truncated."""

    def snapshot(self) -> dict[str, Array]:
        """What a recording keeps of the present moment."""

    def judged(self) -> Array:
        """Where the judged points are, (N, 3) m."""


def play(env: RecordedEnvironment, act: Act, latent: Array, skill: Array) -> tuple[Trajectories, Array]:
    """Feed each simulation its latents, from where it stands.

    Args:
        env: N simulations, already placed; its targets are the goals that success is judged by.
        act: the frozen policy.
        latent: (N, T, d).
        skill: (N, T) the skill whose mean is fed, -1 for other latents.

    Returns:
        The recording (success: the judged point is within the tolerance at the end, and nothing failed on the way) and
        the observations (N, T+1, o).
    """
    num, steps = skill.shape
    moments, actions, rewards = [env.snapshot()], [], []
    observations = [env.observe()]
    length = np.full(num, steps)
    alive = np.ones(num, dtype=bool)
    for t in range(steps):
        step = env.step(act(observations[-1], latent[:, t]))
        observations.append(step.observation)
        rewards.append(np.where(alive, step.reward, 0.0))
        actions.append(np.where(alive[:, None], env.applied, 0.0))
        length[alive & step.terminated] = t + 1
        alive &= ~step.terminated
        moments.append(_frozen(env.snapshot(), moments[-1], ~alive))
    gap = np.linalg.norm(env.judged() - env.target, axis=1)
    state = {name: np.stack([moment[name] for moment in moments], axis=1) for name in moments[0]}
    recording = Trajectories(
        time=np.arange(steps + 1) * env.control_period,
        latent=latent.astype(np.float32),
        skill=skill.astype(np.int32),
        action=np.stack(actions, axis=1).astype(np.float32),
        reward=np.stack(rewards, axis=1).astype(np.float32),
        target=env.target.copy(),
        success=alive & (gap <= env.tolerance),
        length=length,
        **{name: values.astype(np.float32) for name, values in state.items()},
    )
    return recording, np.stack(observations, axis=1)


def _frozen(moment: dict[str, Array], before: dict[str, Array], failed: Array) -> dict[str, Array]:
    """The present moment, where episodes that have failed keep the last state before they did."""
    return {name: np.where(failed.reshape(-1, *(1,) * (now.ndim - 1)), before[name], now) for name, now in moment.items()}


def play_waypoints(env: RecordedEnvironment, act: Act, latent: Array, skill: Array, waypoints: Array) -> Trajectories:
    """Like `play`, judged by waypoints (W, 3) m: all of them approached in order within the tolerance, the last one held.

    Args:
        env: N simulations, already placed.
        act: the frozen policy.
        latent: (N, T, d).
        skill: (N, T).
        waypoints: the last one becomes the target of every simulation.
    """
    env.target[:] = waypoints[-1]
    recording, _ = play(env, act, latent, skill)
    closest = np.array([metrics.ordered_approach(path, waypoints, env.tolerance) for path in recording.judged])
    return recording.judged_by(recording.success & (closest <= env.tolerance).all(axis=1))
