"""TE-PPO: proximal policy optimisation with a task embedding.

The objective is that of Julian et al. 2018 (arXiv:1809.10253, eq. 1), after Hausman et al. 2018:

    max  E[ sum_i gamma^i r^(s_i, a_i, z, t) ]
    r^ = alpha_1 E_t[H{p(z|t)}] + alpha_2 log q(z|window_i) + alpha_3 H{pi(a_i|s_i,z)} + r_t(s_i, a_i)

The term in alpha_2 is part of the reward, because it depends on the policy's actions. The two entropies have gradients of
their own and are part of the loss. One epsilon per episode gives z = mean_t + std_t * epsilon; the policy ratio is evaluated
at that z, so the embedding learns through the policy. Episodes may have mixtures of skills, see `mixtures`.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from skillcli.learning import gaussian
from skillcli.learning.agent import Agent, windows
from skillcli.learning.descent import descend, in_pieces, minibatches, rows
from skillcli.learning.gae import advantages
from skillcli.learning.ppo_update import standardised, update_policy
from skillcli.learning.rollout import Rollout
from skillcli.learning.settings import Training
from skillcli.trajectories import Array


def augmented_reward(reward: Array, log_q: Array, training: Training) -> Array:
    """Add the scaled reward of the task and alpha_2 times the clipped log q(z|window); (T, N) each."""
    diversity = np.clip(log_q, -training.inference_clip, training.inference_clip)
    augmented: Array = training.reward_scale * reward + training.inference_reward * diversity
    return augmented


FINAL_KL_SHARE = 0.05  # of the target KL, at the end of training


def annealed_kl(target: float, anneal_start: float, progress: float) -> float:
    """Return the target KL at a progress of the training: constant up to `anneal_start`, then decreasing linearly."""
    return target * max(FINAL_KL_SHARE, 1.0 - _annealing(anneal_start, progress))


def annealed_std(final: float, anneal_start: float, progress: float) -> float:
    """Return the largest standard deviation of an action: 1 up to `anneal_start`, then decreasing geometrically to `final`.

    Skills learned under noise rely on it: noise helps to move a box.
    """
    settled: float = final ** _annealing(anneal_start, progress)
    return settled


def _annealing(anneal_start: float, progress: float) -> float:
    """Return the progress of annealing: 0 up to `anneal_start`, 1 at the end of the training."""
    return max(0.0, progress - anneal_start) / max(1.0 - anneal_start, 1e-9)


@dataclass(frozen=True)
class Batch:
    """A rollout, flattened to its n valid steps, with everything the losses need."""

    observation: Tensor  # (n, o) normalised
    privileged: Tensor  # (n, p) normalised
    action: Tensor  # (n, a)
    old_log_prob: Tensor  # (n,)
    advantage: Tensor  # (n,) standardised
    value_target: Tensor  # (n,) in units of the value scale
    weights: Tensor  # (n, K) of the skills, one-hot without mixture
    noise: Tensor  # (n, d)
    latent: Tensor  # (n, d) as used in the rollout
    window: Tensor  # (n, H*o) normalised, up to the state after the step


@dataclass
class Optimizers:
    """One per group of weights without common gradients; the policy's step size is adapted."""

    policy: torch.optim.Adam
    value: torch.optim.Adam
    inference: torch.optim.Adam

    @staticmethod
    def of(agent: Agent, rate: float) -> Optimizers:
        """Make Adam for policy and embedding together, for the value function, and for the inference network."""

        def adam(*modules: torch.nn.Module) -> torch.optim.Adam:
            weights = [weight for module in modules for weight in module.parameters()]
            return torch.optim.Adam(weights, lr=rate, eps=1e-5, fused=True)

        return Optimizers(adam(agent.policy, agent.embedding), adam(agent.value), adam(agent.inference))

    @property
    def policy_rate(self) -> float:
        """Return the policy's present step size."""
        return float(self.policy.param_groups[0]["lr"])

    @policy_rate.setter
    def policy_rate(self, rate: float) -> None:
        self.policy.param_groups[0]["lr"] = rate


@torch.no_grad()
def prepare(rollout: Rollout, agent: Agent, training: Training) -> tuple[Batch, dict[str, float]]:
    """Compute values, augmented rewards and advantages of a rollout, flattened; and scalars to log."""
    steps = rollout.action.shape[0]
    observation = agent.normalizer(torch.from_numpy(rollout.observation))  # (T+1, N, o)
    privileged = agent.normalized_privileged(torch.from_numpy(rollout.privileged))  # (T+1, N, p)
    weights = torch.from_numpy(rollout.weights)
    latent = torch.from_numpy(rollout.latent).expand(steps + 1, -1, -1)
    window = windows(observation, agent.window)[1:]  # (T, N, H*o)
    value = in_pieces(agent.value, observation, privileged, latent, weights.expand(steps + 1, -1, -1)).numpy()
    log_q = in_pieces(lambda seen, z: gaussian.log_prob(z, *agent.inference(seen)), window, latent[1:])
    reward = augmented_reward(rollout.reward, log_q.numpy(), training)
    advantage = advantages(
        reward, training.value_scale * value[:-1], training.value_scale * value[-1], rollout.terminated, rollout.valid,
        training.discount, training.gae_lambda,
    )  # fmt: skip
    target = advantage / training.value_scale + value[:-1]

    valid = torch.from_numpy(rollout.valid)
    batch = Batch(
        observation=observation[:-1][valid],
        privileged=privileged[:-1][valid],
        action=torch.from_numpy(rollout.action)[valid],
        old_log_prob=torch.from_numpy(rollout.log_prob)[valid],
        advantage=standardised(torch.from_numpy(advantage)[valid]),
        value_target=torch.from_numpy(target)[valid],
        weights=weights.expand(steps, -1, -1)[valid],
        noise=torch.from_numpy(rollout.noise).expand(steps, -1, -1)[valid],
        latent=latent[1:][valid],
        window=window[valid],
    )
    residual = target[rollout.valid].var()
    explained = 1.0 - (target - value[:-1])[rollout.valid].var() / residual if residual > 0 else 0.0
    return batch, {"inference_log_prob": float(log_q[valid].mean()), "explained_variance": float(explained)}


def update(
    batch: Batch, agent: Agent, optimizers: Optimizers, training: Training, progress: float, rng: np.random.Generator
) -> dict[str, float]:
    """Run several epochs over one batch.

    Policy with embedding, value and inference share no weights and no gradients: they are updated by two threads, in any
    order (three would wait for each other at the interpreter's lock). Each runs its torch operations on one core, so the
    result does not depend on the number of cores.

    `progress` of the training goes from 0 to 1. Towards its end the target KL decreases, so that the last steps settle.
    """
    orders = [rng.permutation(len(batch.action)) for _ in range(training.epochs)]
    target_kl = annealed_kl(training.target_kl, training.settle_from, progress)
    with ThreadPoolExecutor(2, initializer=torch.set_num_threads, initargs=(1,)) as threads:
        actor = threads.submit(_update_actor, batch, agent, optimizers, training, target_kl, orders)
        value = threads.submit(_update_value, batch, agent, optimizers.value, training, orders)
        inference = threads.submit(_update_inference, batch, agent, optimizers.inference, training, orders)
        return actor.result() | value.result() | inference.result()


def _update_actor(
    batch: Batch, agent: Agent, optimizers: Optimizers, training: Training, target_kl: float, orders: list[Array]
) -> dict[str, float]:
    def with_entropies(loss: Tensor) -> Tensor:
        loss = loss - training.policy_entropy * gaussian.entropy(agent.policy.std)
        return loss - training.embedding_entropy * gaussian.entropy(agent.embedding.std).mean()

    kl = update_policy(
        optimizers.policy,
        orders,
        lambda chosen: _log_prob(batch, agent, chosen),
        batch.old_log_prob,
        batch.advantage,
        training,
        target_kl,
        agent.policy.bound,
        with_entropies,
    )
    return {
        "kl": kl,
        "learning_rate": optimizers.policy_rate,
        "action_std": float(agent.policy.std.detach().mean()),
        "embedding_std": float(agent.embedding.std.detach().mean()),
    }


def _log_prob(batch: Batch, agent: Agent, chosen: Tensor) -> Tensor:
    """Compute log pi(a|s, z) at the latents of the present embedding."""
    mean = agent.policy(rows(batch.observation, chosen), present_latent(batch, agent, chosen))
    return gaussian.log_prob(rows(batch.action, chosen), mean, agent.policy.std)


def present_latent(batch: Batch, agent: Agent, chosen: Tensor) -> Tensor:
    """Compute z = mean_t + std_t * epsilon for samples with indices (m,), of the present embedding, (m, d).

    The skill or mixture and the epsilon are those of the rollout. A skill is a mixture with one weight of 1.
    """
    weights, noise = rows(batch.weights, chosen), rows(batch.noise, chosen)
    return weights @ agent.embedding.mean + (weights @ agent.embedding.std) * noise


def _update_value(
    batch: Batch, agent: Agent, optimizer: torch.optim.Adam, training: Training, orders: list[Array]
) -> dict[str, float]:
    def loss(chosen: Tensor) -> Tensor:
        inputs = batch.observation, batch.privileged, batch.latent, batch.weights
        error: Tensor = agent.value(*(rows(samples, chosen) for samples in inputs)) - rows(batch.value_target, chosen)
        return error.square().mean()

    return {"value_loss": _fit(loss, optimizer, training, orders)}


def _update_inference(
    batch: Batch, agent: Agent, optimizer: torch.optim.Adam, training: Training, orders: list[Array]
) -> dict[str, float]:
    def loss(chosen: Tensor) -> Tensor:
        mean, std = agent.inference(rows(batch.window, chosen))
        return -gaussian.log_prob(rows(batch.latent, chosen), mean, std).mean()

    return {"inference_loss": _fit(loss, optimizer, training, orders)}


def _fit(loss: Callable[[Tensor], Tensor], optimizer: torch.optim.Adam, training: Training, orders: list[Array]) -> float:
    """Descend on the minibatches of every epoch; return the last loss."""
    last = torch.zeros(())
    for order in orders:
        for chosen in minibatches(order, training.minibatch):
            last = loss(chosen)
            descend(optimizer, last, training.max_grad_norm)
    return float(last.detach())
