"""Proximal policy optimisation over latents, with the advantages and the update of the on-policy learner."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from skillcli.composition.latent_bounds import LatentBounds
from skillcli.learning import gaussian
from skillcli.learning.composer import Head, Normalizer, Trace, arrays_of, check_finite, tensor
from skillcli.learning.descent import descend, minibatches, rows
from skillcli.learning.gae import advantages
from skillcli.learning.ppo_method import PpoSettings
from skillcli.learning.ppo_update import standardised, update_policy
from skillcli.seeding import generator, torch_generator
from skillcli.trajectories import Array

MIN_STD = 0.02  # of the exploration, in units of half the range of latents


class PpoComposer:
    """See `composition.episodes.Composer`. pi(z|s) is a Gaussian in units of the bounds; samples beyond them are clipped.

    Args:
        features: size f.
        bounds: (2, d) lowest and highest latent.
        settings: from the recipe.
        seed: of weights and random numbers.
    """

    def __init__(self, features: int, bounds: Array, settings: PpoSettings, seed: int) -> None:
        torch.set_num_threads(1)  # results must not depend on the number of cores
        self._settings, self._rng, size = settings, generator(seed, "ppo"), bounds.shape[1]
        self._bounds = LatentBounds(bounds)
        make = torch_generator(seed, "ppo")
        self.normalizer = Normalizer(features)
        self.policy = Head(features, settings.hidden, size, True, 0.01, make)
        self.value = Head(features, settings.hidden, 1, False, 1.0, make)
        self.log_std = torch.nn.Parameter(torch.full((size,), math.log(settings.initial_std)))
        self._actor = torch.optim.Adam([*self.policy.parameters(), self.log_std], lr=settings.learning_rate)
        self._critic = torch.optim.Adam(self.value.parameters(), lr=settings.learning_rate)
        self._trace = Trace()
        self._round = 0

    @torch.no_grad()
    def act(self, features: Array) -> Array:
        """See `Composer`."""
        mean = self.policy(self.normalizer(tensor(features)))
        noise = tensor(self._rng.standard_normal(mean.shape))
        noise[0] = 0.0
        unit = mean + self.log_std.exp() * noise
        self._trace.chose(features, unit.numpy())
        return self._bounds.latent(unit.numpy())

    def observe(self, reward: Array, features: Array, terminated: Array) -> None:
        """See `Composer`."""
        self._trace.observe(reward, features, terminated)

    def update(self, valid: Array) -> dict[str, float]:
        """See `Composer`; the first episode is left out, because it was not sampled from the policy."""
        on_policy = valid.copy()
        on_policy[:, 0] = False
        seen = tensor(np.stack(self._trace.seen))  # (T+1, N, f)
        if self._round == 0:  # the first update needs statistics to normalise with
            self.normalizer.update(seen.flatten(0, 1))
        logged = self._update(self.normalizer(seen), tensor(np.stack(self._trace.units)), on_policy)
        if self._round > 0:
            self.normalizer.update(seen.flatten(0, 1))
        self._trace = Trace()
        self._round += 1
        check_finite("ppo", logged, self.policy, self.value)
        return logged

    def arrays(self) -> dict[str, Array]:
        """See `Composer`."""
        weights = arrays_of(normalizer=self.normalizer, policy=self.policy, value=self.value)
        return {**weights, "policy.log_std": self.log_std.detach().numpy().copy()}

    def _update(self, seen: Tensor, unit: Tensor, valid: Array) -> dict[str, float]:
        """Run several epochs over one round: normalised features (T+1, N, f), units (T, N, d), valid (T, N)."""
        settings, chosen = self._settings, torch.from_numpy(valid)
        with torch.no_grad():
            value = self.value(seen).squeeze(-1).numpy()
            old = gaussian.log_prob(unit, self.policy(seen[:-1]), self.log_std.exp())[chosen]
        advantage = advantages(
            np.stack(self._trace.rewards), value[:-1], value[-1], np.stack(self._trace.terminated), valid,
            settings.discount, settings.gae_lambda,
        )  # fmt: skip
        target = tensor(advantage + value[:-1])[chosen]
        return self._epochs(seen[:-1][chosen], unit[chosen], old, standardised(tensor(advantage)[chosen]), target)

    def _epochs(self, seen: Tensor, unit: Tensor, old: Tensor, advantage: Tensor, target: Tensor) -> dict[str, float]:
        settings = self._settings
        orders = [self._rng.permutation(len(seen)) for _ in range(settings.epochs)]
        kl = update_policy(
            self._actor,
            orders,
            lambda chosen: gaussian.log_prob(rows(unit, chosen), self.policy(rows(seen, chosen)), self.log_std.exp()),
            old,
            advantage,
            settings,
            settings.target_kl,
            self._bound,
        )
        value_loss = torch.zeros(())
        for order in orders:
            for chosen in minibatches(order, settings.minibatch):
                value_loss = (self.value(rows(seen, chosen)).squeeze(-1) - rows(target, chosen)).square().mean()
                descend(self._critic, value_loss, settings.max_grad_norm)
        return {
            "kl": kl,
            "value_loss": float(value_loss.detach()),
            "learning_rate": self._actor.param_groups[0]["lr"],
            "latent_std": float(self.log_std.detach().exp().mean()),
        }

    @torch.no_grad()
    def _bound(self) -> None:
        self.log_std.clamp_(math.log(MIN_STD), 0.0)
