"""Deep deterministic policy gradient over latents (Lillicrap et al. 2016, arXiv:1509.02971).

The actor mu(s) proposes a latent. With a discrete set, the nearest latent is taken, or of several near ones the one with the
highest Q (Dulac-Arnold et al. 2015, arXiv:1512.07679); everything else, including the exploration noise, is unchanged.
"""

from __future__ import annotations

import copy

import numpy as np
import torch
from torch import Tensor

from skillcli.composition.latent_bounds import LatentBounds
from skillcli.learning.composer import Head, Normalizer, Trace, arrays_of, check_finite, tensor
from skillcli.learning.ddpg_method import DdpgSettings
from skillcli.learning.descent import descend
from skillcli.learning.ring_buffer import RingBuffer
from skillcli.seeding import generator, torch_generator
from skillcli.trajectories import Array

FINAL = 0.1  # share of the initial exploration and step size in the last round: the last steps settle


class DdpgComposer:
    """See `composition.episodes.Composer`.

    Args:
        features: size f.
        bounds: (2, d) lowest and highest latent.
        choices: (C, d) the allowed latents, None for any within the bounds.
        settings: from the recipe.
        seed: of weights and random numbers.
    """

    def __init__(self, features: int, bounds: Array, choices: Array | None, settings: DdpgSettings, seed: int) -> None:
        torch.set_num_threads(1)  # results must not depend on the number of cores
        self._settings, self._rng, size = settings, generator(seed, "ddpg"), bounds.shape[1]
        self._bounds = LatentBounds(bounds)
        self._choices = None if choices is None else tensor(self._bounds.unit(choices))
        make = torch_generator(seed, "ddpg")
        self.normalizer = Normalizer(features)
        self.actor = Head(features, settings.hidden, size, False, 0.01, make)
        self.critic = Head(features + size, settings.hidden, 1, False, 1.0, make)
        self._target_actor, self._target_critic = copy.deepcopy(self.actor), copy.deepcopy(self.critic)
        self._optimizers = [torch.optim.Adam(net.parameters(), lr=settings.learning_rate) for net in (self.actor, self.critic)]
        self.replay = RingBuffer(settings.replay, np.float32)  # features, unit, reward, features then, whether that is the end
        self._round = 0
        self._trace = Trace()

    @torch.no_grad()
    def act(self, features: Array) -> Array:
        """See `Composer`; in the first rounds every episode holds one latent, drawn uniformly within the bounds."""
        seen = self.normalizer(tensor(features))
        unit = self.actor(seen)
        if self._round < self._settings.warm_up:
            if not self._trace.units:
                self._drawn = self._rng.uniform(-1, 1, unit.shape)
            unit[1:] = tensor(self._drawn)[1:]
        else:
            unit[1:] += self._noise() * tensor(self._rng.standard_normal(unit[1:].shape))
        unit = self.project(unit.clamp(-1, 1), seen, self.critic)
        self._trace.chose(features, unit.numpy())
        return self._bounds.latent(unit.numpy())

    def observe(self, reward: Array, features: Array, terminated: Array) -> None:
        """See `Composer`."""
        self._trace.observe(reward, features, terminated)

    def update(self, valid: Array) -> dict[str, float]:
        """See `Composer`."""
        trace = self._trace
        for t, kept in enumerate(valid):
            columns = trace.seen[t], trace.units[t], trace.rewards[t], trace.seen[t + 1], trace.terminated[t]
            self.replay.add(*(column[kept] for column in columns))
        if self._round < self._settings.warm_up:  # the scale of the features is known then, and fixed from there on
            self.normalizer.update(tensor(np.concatenate(trace.seen)))
        self._trace = Trace()
        self._round += 1
        logged = {"critic_loss": 0.0, "q": 0.0, "noise": self._noise()}
        for optimizer in self._optimizers:
            optimizer.param_groups[0]["lr"] = self._settings.learning_rate * self._left()
        for _ in range(self._settings.gradient_steps):
            logged |= self._step(acting=self._round >= self._settings.warm_up)
        check_finite("ddpg", logged, self.actor, self.critic)
        return logged

    def arrays(self) -> dict[str, Array]:
        """See `Composer`."""
        return arrays_of(normalizer=self.normalizer, actor=self.actor, critic=self.critic)

    def project(self, unit: Tensor, seen: Tensor, critic: Head) -> Tensor:
        """Map proposed units (N, d) to allowed ones; without choices all are allowed."""
        if self._choices is None:
            return unit
        count = min(self._settings.candidates, len(self._choices))
        near = torch.cdist(unit, self._choices).topk(count, largest=False).indices  # (N, k)
        options = self._choices[near]  # (N, k, d)
        if count == 1:
            return options[:, 0]
        value = critic(seen[:, None].expand(-1, count, -1), options).squeeze(-1)  # (N, k)
        return options[torch.arange(len(unit)), value.argmax(-1)]

    def _noise(self) -> float:
        return self._settings.noise * self._left()

    def _left(self) -> float:
        """Decrease linearly from 1 in the first round to `FINAL` in the last."""
        return 1.0 - (1.0 - FINAL) * min(1.0, self._round / self._settings.iterations)

    def _step(self, acting: bool) -> dict[str, float]:
        """Take one gradient step of the critic and, if `acting`, of the actor; then update the target networks."""
        features, unit, reward, after, end = map(torch.from_numpy, self.replay.sample(self._settings.minibatch, self._rng))
        seen, seen_after = self.normalizer(features), self.normalizer(after)
        with torch.no_grad():
            then = self.project(self._target_actor(seen_after).clamp(-1, 1), seen_after, self._target_critic)
            bootstrap = self._target_critic(seen_after, then).squeeze(-1)
            target = reward + self._settings.discount * (1.0 - end) * bootstrap
        critic_loss = (self.critic(seen, unit).squeeze(-1) - target).square().mean()
        descend(self._optimizers[1], critic_loss)
        if acting:  # not before the critic has learned a little
            unit = self.actor(seen)
            descend(self._optimizers[0], -(self._inverted_gradient(seen, unit.detach()) * unit).sum(-1).mean())
        self._polyak_update()
        return {"critic_loss": float(critic_loss.detach()), "q": float(target.mean())}

    def _inverted_gradient(self, seen: Tensor, unit: Tensor) -> Tensor:
        """Return dQ/da at actions (n, d), scaled down towards the bound it points to, and inverted beyond it.

        A tanh instead would get stuck in the first corner that an untrained critic prefers (Hausknecht and Stone 2016,
        arXiv:1511.04143, section 4).
        """
        unit.requires_grad_()
        (gradient,) = torch.autograd.grad(self.critic(seen, unit).sum(), unit)
        room = torch.where(gradient > 0, 1.0 - unit, 1.0 + unit) / 2
        return gradient * room.detach()

    @torch.no_grad()
    def _polyak_update(self) -> None:
        """Update the target networks by tau (Lillicrap et al. 2016, algorithm 1)."""
        for target, net in ((self._target_actor, self.actor), (self._target_critic, self.critic)):
            for slow, fast in zip(target.parameters(), net.parameters(), strict=True):
                slow.lerp_(fast, self._settings.target_rate)
