"""Generalised advantage estimation (Schulman et al. 2016, arXiv:1506.02438, eq. 16)."""

from __future__ import annotations

import numpy as np

from skillcli.trajectories import Array


def advantages(
    reward: Array, value: Array, last_value: Array, terminated: Array, valid: Array, discount: float, gae_lambda: float
) -> Array:
    """Compute the advantages of a batch of episodes.

    The value of the state after the last step is bootstrapped if time ran out (truncation), and is zero if the episode failed
    (termination): the two must not be confused.

    Args:
        reward: (T, N) rewards.
        value: (T, N) values of the states before each step.
        last_value: (N,) values of the states after the last step.
        terminated: (T, N) bool, whether the step ended in failure.
        valid: (T, N) bool, False for steps after the end of an episode.
        discount: gamma.
        gae_lambda: lambda.

    Returns:
        (T, N) advantages, zero where invalid.
    """
    result = np.zeros_like(reward)
    running = np.zeros_like(last_value)
    next_value = last_value
    for t in range(reward.shape[0] - 1, -1, -1):
        alive = np.where(terminated[t], 0.0, 1.0)
        delta = reward[t] + discount * alive * next_value - value[t]
        running = np.where(valid[t], delta + discount * gae_lambda * alive * running, 0.0)
        result[t] = running
        next_value = value[t]
    return result
