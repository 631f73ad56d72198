"""The PPO update of a policy, for skills and composers: clipped surrogate, minibatches, step size adapted to the KL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import torch
from torch import Tensor

from skillcli.learning.descent import descend, minibatches, rows
from skillcli.trajectories import Array

RATES = (1e-5, 1e-2)
"""Smallest and largest step size of the policy."""


class PpoParameters(Protocol):
    """Settings of the update."""

    @property
    def minibatch(self) -> int:
        """Samples per gradient step."""

    @property
    def clip(self) -> float:
        """Clipping range of the policy ratio."""

    @property
    def max_grad_norm(self) -> float:
        """Largest norm of a gradient."""


def surrogate_loss(log_prob: Tensor, old_log_prob: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """Compute PPO's clipped surrogate, negated (Schulman et al. 2017, arXiv:1707.06347, eq. 7); (n,) each to a scalar."""
    ratio = (log_prob - old_log_prob).exp()
    clipped = ratio.clamp(1.0 - clip, 1.0 + clip)
    return -torch.min(ratio * advantage, clipped * advantage).mean()


def approximate_kl(log_prob: Tensor, old_log_prob: Tensor) -> Tensor:
    """Estimate KL(old || new) from samples of old, unbiased and non-negative: (r - 1) - log r (Schulman 2020)."""
    log_ratio = log_prob - old_log_prob
    return (log_ratio.exp() - 1.0 - log_ratio).mean()


def adapted_learning_rate(rate: float, kl: float, target: float) -> float:
    """Reduce the step size if the policy moved too far, raise it if it hardly moved; within `RATES`."""
    if kl > 2.0 * target:
        rate /= 1.5
    elif kl < 0.5 * target:
        rate *= 1.5
    return min(max(rate, RATES[0]), RATES[1])


def standardised(advantage: Tensor) -> Tensor:
    """Standardise advantages (n,) to mean 0 and standard deviation 1."""
    return (advantage - advantage.mean()) / (advantage.std() + 1e-8)


def update_policy(
    optimizer: torch.optim.Optimizer,
    orders: Sequence[Array],
    log_prob: Callable[[Tensor], Tensor],
    old_log_prob: Tensor,
    advantage: Tensor,
    parameters: PpoParameters,
    target_kl: float,
    bound: Callable[[], None],
    regularise: Callable[[Tensor], Tensor] = lambda loss: loss,
) -> float:
    """Run several epochs over n samples.

    Args:
        optimizer: of the policy; its step size is adapted after each epoch.
        orders: a permutation (n,) for each epoch.
        log_prob: computes the log density of some samples' actions under the present policy, indices (m,) to (m,).
        old_log_prob: (n,) under the policy that sampled them.
        advantage: (n,) standardised.
        parameters: see `PpoParameters`.
        target_kl: KL divergence per epoch that the step size is adapted to, nat.
        bound: clips the policy to its bounds after each step.
        regularise: adds further terms to the loss.

    Returns:
        KL divergence of the last epoch, nat.
    """
    kl = 0.0
    for order in orders:
        divergences: list[float] = []
        for chosen in minibatches(order, parameters.minibatch):
            new, old = log_prob(chosen), rows(old_log_prob, chosen)
            loss = regularise(surrogate_loss(new, old, rows(advantage, chosen), parameters.clip))
            descend(optimizer, loss, parameters.max_grad_norm)
            bound()
            divergences.append(float(approximate_kl(new.detach(), old)))
        kl = sum(divergences) / len(divergences)
        group = optimizer.param_groups[0]
        group["lr"] = adapted_learning_rate(group["lr"], kl, target_kl)
    return kl
