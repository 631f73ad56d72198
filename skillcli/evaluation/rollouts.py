"""Run the frozen policy on latents, deterministic and closed loop, and record trajectories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from skillcli import metrics
from skillcli.trajectories import Array, Trajectories

Act = Callable[[Array, Array], Array]  # observations (N, o) and latents (N, d) to actions (N, a)
Conditioning = Callable[[int, Array], tuple[Array, Array, Array] | None]


class RecordedEnvironment(Protocol):
    """What a recording needs of N simulations."""

    num_envs: int
    control_period: float
    tolerance: float
    desired_goal: Array
    applied: Array
    unstable: Array

    def observe(self) -> Array:
        """Return observations (N, o)."""

    def step(self, action: Array) -> Any:
        """Apply one control step; returns observation, reward, terminated, truncated."""

    def recorded_state(self) -> dict[str, Array]:
        """Return the fields of the present state that are recorded."""

    def achieved_goal(self) -> Array:
        """Return the achieved goal of each simulation, (N, 3) m."""

    def violations(self) -> Array:
        """Return which of `SAFETY_LIMITS` each state violates, (N, K) bool; K is 0 without limits."""


def rollout(
    env: RecordedEnvironment, act: Act, latent: Array, skill: Array, steps: Array | None = None
) -> tuple[Trajectories, Array]:
    """Condition the policy on each simulation's latents, from its present state.

    Args:
        env: N simulations in their start states; success is measured at their desired goals.
        act: the frozen policy.
        latent: (N, T, d).
        skill: (N, T) the skill whose mean the latent is, -1 for other latents.
        steps: (N,) control steps of each simulation, T by default; afterwards its recording repeats the last state.

    Returns:
        The recording (success: the achieved goal is within the tolerance at the end, and nothing failed on the way) and
        the observations (N, T+1, o).
    """
    num_envs, last = skill.shape
    length = np.full(num_envs, last) if steps is None else steps
    return rollout_closed_loop(env, act, lambda t, failed: (latent[:, t], skill[:, t], t < length), last)


def rollout_closed_loop(env: RecordedEnvironment, act: Act, condition: Conditioning, steps: int) -> tuple[Trajectories, Array]:
    """Do the same as `rollout`, but choose the next latents from what has happened.

    Args:
        env: N simulations in their start states.
        act: the frozen policy.
        condition: called before each control step with its number and which simulations have failed, (N,) bool. Returns
            latents (N, d), the skills (N,) whose means they are, and which episodes still run, (N,) bool; None ends all.
        steps: at most.
    """
    num_envs = env.num_envs
    moments, actions, rewards, conditioned, violated = [_moment(env)], [], [], [], []
    observations = [env.observe()]
    length, failed, unstable = np.zeros(num_envs, dtype=int), np.zeros(num_envs, dtype=bool), np.zeros(num_envs, dtype=bool)
    for t in range(steps):
        given = condition(t, failed)
        if given is None:
            break
        latent, skill, running = given
        running = running & ~failed
        step = env.step(act(observations[-1], latent))
        conditioned.append((latent, skill))
        observations.append(step.observation)
        rewards.append(np.where(running, step.reward, 0.0))
        actions.append(np.where(running[:, None], env.applied, 0.0))
        failing = running & step.terminated
        length[running] = t + 1
        violated.append(env.violations() & running[:, None])
        failed |= failing
        unstable |= failing & env.unstable
        moments.append(_frozen(_moment(env), moments[-1], ~running | failing))
    broken = np.stack(violated, axis=1)  # (N, T, L)
    state = {name: np.stack([moment[name] for moment in moments], axis=1) for name in moments[0]}
    recording = Trajectories(
        time=np.arange(len(moments)) * env.control_period,
        latent=np.stack([latent for latent, _ in conditioned], axis=1).astype(np.float32),
        skill=np.stack([skill for _, skill in conditioned], axis=1).astype(np.int32),
        action=np.stack(actions, axis=1).astype(np.float32),
        reward=np.stack(rewards, axis=1).astype(np.float32),
        target=env.desired_goal.copy(),
        success=~failed,
        length=length,
        unstable=unstable if unstable.any() else None,
        violations=broken.sum(axis=1, dtype=np.int32) if broken.shape[2] else None,
        violated=broken if broken.any() else None,
        **{name: values.astype(np.float32) for name, values in state.items()},
    )
    if np.array_equal(recording.usual_achieved_goal, recording.achieved_goal):
        recording = replace(recording, judged_position=None)
    near = metrics.final_distance(recording) <= env.tolerance
    return recording.with_success(recording.success & near), np.stack(observations, axis=1)


def _moment(env: RecordedEnvironment) -> dict[str, Array]:
    return {**env.recorded_state(), "judged_position": env.achieved_goal()}


def _frozen(moment: dict[str, Array], before: dict[str, Array], over: Array) -> dict[str, Array]:
    """Return the present state; episodes that are over or have just failed keep the state before."""
    return {name: np.where(over.reshape(-1, *(1,) * (now.ndim - 1)), before[name], now) for name, now in moment.items()}


def rollout_waypoints(
    env: RecordedEnvironment, act: Act, latent: Array, skill: Array, waypoints: Sequence[Array], steps: Array | None = None
) -> Trajectories:
    """Do the same as `rollout`; success needs all waypoints met in order within the tolerance, and the end at the last one.

    Args:
        env: N simulations in their start states.
        act: the frozen policy.
        latent: (N, T, d).
        skill: (N, T).
        waypoints: (W, 3) m for each simulation; the last one becomes its desired goal.
        steps: see `rollout`.
    """
    env.desired_goal[:] = [route[-1] for route in waypoints]
    recording, _ = rollout(env, act, latent, skill, steps)
    return recording.with_success(recording.success & met(recording, waypoints, env.tolerance))


def met(recording: Trajectories, waypoints: Sequence[Array], tolerance: float) -> Array:
    """Return which episodes meet their waypoints (W, 3) m in order within the tolerance, (E,) bool."""
    return np.array([
        bool((metrics.ordered_approach(path, route, tolerance) <= tolerance).all())
        for path, route in zip(recording.achieved_goal, waypoints, strict=True)
    ])  # fmt: skip
