"""The four networks of TE-PPO and the normaliser of observations.

Names follow the paper: policy pi(a|s,z), embedding p(z|t), inference q(z|window), value V(s,z,t).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from skillcli.learning.gaussian import bounded_std, inverse_bounded_std
from skillcli.trajectories import Array


class _Tanh(torch.autograd.Function):
    """torch.tanh takes as long on a CPU as the multiplication by a layer's weights; its sigmoid takes a sixth of that."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        y = torch.sigmoid(2.0 * x).mul_(2.0).sub_(1.0)
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        (y,) = ctx.saved_tensors
        return torch.ops.aten.tanh_backward(gradients[0], y)  # type: ignore[no-any-return]


def tanh(x: Tensor) -> Tensor:
    """Compute tanh(x) as 2 sigmoid(2x) - 1, within 2e-7 of `torch.tanh`; once differentiable."""
    y: Tensor = _Tanh.apply(x)  # type: ignore[no-untyped-call]
    return y


class Tanh(nn.Module):
    """The layer of `tanh`."""

    def forward(self, x: Tensor) -> Tensor:
        """Compute tanh, same shape."""
        return tanh(x)


def mlp(sizes: Sequence[int], last_gain: float, generator: torch.Generator) -> nn.Sequential:
    """Make a tanh multilayer perceptron, sizes from input to output, orthogonal weights, zero biases."""
    layers: list[nn.Module] = []
    for i, (fan_in, fan_out) in enumerate(itertools.pairwise(sizes)):
        last = i == len(sizes) - 2
        linear = nn.Linear(fan_in, fan_out)
        nn.init.orthogonal_(linear.weight, last_gain if last else math.sqrt(2.0), generator=generator)
        nn.init.zeros_(linear.bias)
        layers += [linear] if last else [linear, Tanh()]
    return nn.Sequential(*layers)


class Policy(nn.Module):
    """pi(a|s,z): mean from the network, standard deviation per action dimension. Actions are in units of the limit.

    Args:
        observation: size o.
        latent: size d.
        action: size a.
        hidden: layers.
        std: initial standard deviation of the action.
        generator: of the initial weights.
        linear: the mean is affine in z, f(s) + G(s) z. Then a latent between two skills gives an action between theirs in
            every state: the latent space inherits the metric of the actions. Otherwise z is one more input.
    """

    MIN_STD = 0.02

    def __init__(
        self,
        observation: int,
        latent: int,
        action: int,
        hidden: Sequence[int],
        std: float,
        generator: torch.Generator,
        linear: bool = False,
    ) -> None:
        super().__init__()
        self.linear = linear
        inputs, outputs = (observation, action * (1 + latent)) if linear else (observation + latent, action)
        self.body = mlp([inputs, *hidden, outputs], 0.01, generator)
        self.log_std = nn.Parameter(torch.full((action,), math.log(std)))

    def forward(self, observation: Tensor, latent: Tensor) -> Tensor:
        """Compute the mean action: normalised observations (..., o) and latents (..., d) to (..., a)."""
        if self.linear:
            return affine(self.body(observation), latent)
        mean: Tensor = self.body(torch.cat([observation, latent], -1))
        return mean

    @property
    def std(self) -> Tensor:
        """Return the standard deviation of the action, (a,)."""
        return self.log_std.exp()

    @torch.no_grad()
    def bound(self, max_std: float = 1.0) -> None:
        """Clip the standard deviation to its bounds; between gradient steps, so that it can always return."""
        self.log_std.clamp_(math.log(self.MIN_STD), math.log(max_std))


def affine(parts: Tensor, latent: Tensor) -> Tensor:
    """Compute f + G z from both in one array: (..., (1 + d) * a) and (..., d) to (..., a)."""
    offset, *slopes = parts.chunk(1 + latent.shape[-1], -1)
    for slope, component in zip(slopes, latent.unbind(-1), strict=True):
        offset = torch.addcmul(offset, slope, component[..., None])
    return offset


class Embedding(nn.Module):
    """p(z|t): per skill a mean in (-1, 1) and a bounded standard deviation; fixed means are not learned."""

    def __init__(self, mean: Tensor, std: float, bounds: tuple[float, float], fixed: bool = False) -> None:
        super().__init__()
        self.bounds = bounds
        self.raw_mean = nn.Parameter(torch.atanh(mean), requires_grad=not fixed)
        self.raw_std = nn.Parameter(torch.full_like(mean, inverse_bounded_std(std, *bounds)))

    @property
    def mean(self) -> Tensor:
        """Return the means, (K, d)."""
        return torch.tanh(self.raw_mean)

    @property
    def std(self) -> Tensor:
        """Return the standard deviations, (K, d)."""
        return bounded_std(self.raw_std, *self.bounds)


def spread(points: int, dimensions: int, generator: torch.Generator) -> Tensor:
    """Spread points over the cube [-0.8, 0.8]^d, (points, d): random initial points that repel each other.

    Skills that begin close together in the latent space are slow to separate.
    """
    x = torch.rand(points, dimensions, generator=generator) * 1.6 - 0.8
    for _ in range(200):
        offset = x[:, None] - x[None]  # (K, K, d)
        squared = offset.square().sum(-1, keepdim=True) + 1e-3
        x = (x + 0.02 * (offset / squared).sum(1)).clamp(-0.8, 0.8)
    return x


def set_apart(goals: Array, mixing: Sequence[int]) -> Array:
    """Give each skill that cannot be mixed an axis of its own: (K, 3) m to (K, 3 + K - M) with M skills that can.

    It lies off the middle of the others' goals, by their largest distance from it: its own goal may be in their midst.
    """
    apart = [skill for skill in range(len(goals)) if skill not in mixing]
    if not apart:
        return goals
    others = np.delete(goals, apart, axis=0)
    middle = others.mean(axis=0) if len(others) else goals.mean(axis=0)
    places = np.zeros((len(goals), goals.shape[1] + len(apart)))
    places[:, : goals.shape[1]] = goals
    places[apart, : goals.shape[1]] = middle
    far = float(np.linalg.norm(others - middle, axis=1).max(initial=0.0)) or 1.0
    places[apart, goals.shape[1] + np.arange(len(apart))] = far
    return places


def arranged(goals: Tensor, dimensions: int, generator: torch.Generator, isometric: bool = False) -> Tensor:
    """Arrange points like the goals in the cube [-0.8, 0.8]^d: (K, 3) m to (K, d).

    Each principal axis of the goals is divided by the root of its singular value: long axes shrink towards short ones, so
    that skills with near goals still get separate latents, and distances keep their order. Isometric: all axes have one
    scale, so that distances keep their proportions. If goals coincide, the points are spread at random.
    """
    centred = goals - goals.mean(0)
    left, singular, _ = torch.linalg.svd(centred, full_matrices=False)
    rank = int((singular > 1e-6 * singular.max().clamp(min=1e-12)).sum())
    x = torch.zeros(len(goals), dimensions)
    used = min(rank, dimensions)
    x[:, :used] = left[:, :used] * (singular[:used] if isometric else singular[:used].sqrt())
    x = 0.8 * x / x.abs().max().clamp(min=1e-6)
    separate = len(goals) == 1 or float(torch.pdist(x).min()) > 0.2
    return x if separate else spread(len(goals), dimensions, generator)


class Inference(nn.Module):
    """q(z|window): a Gaussian over latents from the last H observations."""

    MIN_STD, MAX_STD = 0.03, 1.0

    def __init__(self, window_size: int, latent: int, hidden: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
        self.body = mlp([window_size, *hidden, 2 * latent], 0.1, generator)

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and standard deviation, (..., d) each, from flattened windows (..., H*o)."""
        mean, raw_std = self.body(window).chunk(2, -1)
        return mean, bounded_std(raw_std, self.MIN_STD, self.MAX_STD)


EPSILON = 1e-6  # added to the variance: what never varied is not divided by zero
CLIP = 5.0  # normalised observations stay within this many standard deviations


class Normalizer(nn.Module):
    """Running mean and variance of observations, updated only between rollouts."""

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    def forward(self, observation: Tensor) -> Tensor:
        """Normalize (..., o) to zero mean and unit variance, clipped."""
        return ((observation - self.mean) * self.scale()).clamp(-CLIP, CLIP)

    def scale(self) -> Tensor:
        """Return one over the standard deviation, (o,)."""
        return (self.variance + EPSILON).rsqrt()

    @torch.no_grad()
    def update(self, observation: Tensor) -> None:
        """Update with a batch (n, o), by the parallel variance formula of Chan et al. (1979)."""
        n = float(observation.shape[0])
        mean, variance = observation.mean(0), observation.var(0, unbiased=False)
        total = self.count + n
        delta = mean - self.mean
        self.variance += (variance - self.variance) * (n / total) + delta.square() * (self.count * n / total**2)
        self.mean += delta * (n / total)
        self.count += n


class Value(nn.Module):
    """V(s,z,t), in units of the value scale; it may observe the skill and privileged values (Pinto et al. 2017)."""

    def __init__(
        self, observation: int, privileged: int, latent: int, skills: int, hidden: Sequence[int], generator: torch.Generator
    ) -> None:
        super().__init__()
        self.body = mlp([observation + privileged + latent + skills, *hidden, 1], 1.0, generator)

    def forward(self, observation: Tensor, privileged: Tensor, latent: Tensor, weights: Tensor) -> Tensor:
        """(..., o) and (..., p) normalised, (..., d), weights of the skills (..., K), one-hot for one of them, to (...,)."""
        value: Tensor = self.body(torch.cat([observation, privileged, latent, weights], -1)).squeeze(-1)
        return value
