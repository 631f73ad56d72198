"""All networks of one skill library: built from a recipe, stored as plain arrays, frozen after training."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from skillcli.learning.networks import (
    CLIP,
    Embedding,
    Inference,
    Normalizer,
    Policy,
    Value,
    affine,
    arranged,
    set_apart,
    spread,
)
from skillcli.learning.settings import LearningRecipe
from skillcli.seeding import torch_generator
from skillcli.trajectories import Array


class Agent(nn.Module):
    """pi(a|s,z), p(z|t), q(z|window), V(s,z,t) and their common normaliser.

    Args:
        recipe: gives the sizes.
        observation: observation size o.
        action: action size a.
        goals: (K, 3) m, one per skill; they only arrange the embedding's initial means.
        seed: of the initial weights.
        privileged: size p of the value function's own observations.
    """

    def __init__(
        self, recipe: LearningRecipe, observation: int, action: int, goals: Array, seed: int = 0, privileged: int = 0
    ) -> None:
        super().__init__()
        torch.set_num_threads(1)  # results must not depend on the number of cores
        embedding, network = recipe.embedding, recipe.network
        skills = len(goals)
        self.window, self.skills = embedding.window, skills
        make = torch_generator(seed, "networks")
        self.normalizer = Normalizer(observation)
        if privileged:
            self.privileged_normalizer = Normalizer(privileged)
        self.policy = Policy(
            observation, embedding.size, action, network.policy_hidden, network.initial_action_std, make, network.linear_latent
        )
        bounds = (embedding.min_std, embedding.max_std)
        first_means = (
            spread(skills, embedding.size, make)
            if embedding.arrangement == "random"
            else arranged(
                torch.as_tensor(set_apart(goals, recipe.task.mixing), dtype=torch.float32),
                embedding.size,
                make,
                embedding.arrangement == "isometric",
            )
        )
        self.embedding = Embedding(first_means, embedding.initial_std, bounds, embedding.fixed_means)
        window_size = embedding.window * observation
        self.inference = Inference(window_size, embedding.size, network.inference_hidden, make)
        self.value = Value(observation, privileged, embedding.size, skills, network.value_hidden, make)

    @torch.no_grad()
    def act(self, observation: Array, latent: Array) -> Array:
        """Compute deterministic actions in units of the action limit: (N, o), (N, d) to (N, a)."""
        normalized = self.normalizer(torch.as_tensor(observation, dtype=torch.float32))
        mean: Array = self.policy(normalized, torch.as_tensor(latent, dtype=torch.float32)).numpy()
        return mean

    def normalized_privileged(self, privileged: Tensor) -> Tensor:
        """Normalize privileged observations (..., p) to zero mean and unit variance; p may be 0."""
        if privileged.shape[-1] == 0:
            return privileged
        normalized: Tensor = self.privileged_normalizer(privileged)
        return normalized

    def update_normalizers(self, observation: Tensor, privileged: Tensor) -> None:
        """Update the statistics with a batch, (n, o) and (n, p)."""
        self.normalizer.update(observation)
        if privileged.shape[-1]:
            self.privileged_normalizer.update(privileged)

    @torch.no_grad()
    def embed(self) -> tuple[Array, Array]:
        """Return mean and standard deviation of p(z|t) per skill, (K, d) each."""
        return self.embedding.mean.numpy().astype(np.float64), self.embedding.std.numpy().astype(np.float64)

    @torch.no_grad()
    def infer(self, windows: Array) -> Array:
        """Compute the mean of q(z|window) for windows (N, H, o) of raw observations, (N, d)."""
        normalized = self.normalizer(torch.as_tensor(windows, dtype=torch.float32))
        mean: Array = self.inference(normalized.flatten(1))[0].numpy()
        return mean

    def arrays(self) -> dict[str, Array]:
        """Return every weight by its dotted name."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self.state_dict().items()}

    def load(self, arrays: Mapping[str, Array]) -> None:
        """Load the weights that `arrays` returned."""
        self.load_state_dict({name: torch.from_numpy(np.array(array)) for name, array in arrays.items()})


class Actor:
    """pi's mean for latents that are constant over an episode: their part of the first layer is computed once.

    Sampling calls this once per control step; its numbers equal those of `Agent.act` up to rounding. The tanh of a hidden
    layer is 2 sigmoid(2x) - 1 there; here the layers around it take over its factors and its offset, and a sigmoid is left.

    Args:
        agent: its weights are copied; later updates do not change this actor.
        latent: (N, d).
    """

    @torch.no_grad()
    def __init__(self, agent: Agent, latent: Array) -> None:
        first, *rest = (layer for layer in agent.policy.body if isinstance(layer, nn.Linear))
        size = agent.normalizer.mean.shape[0]
        self._latent = torch.as_tensor(latent, dtype=torch.float32)
        self._linear = agent.policy.linear
        scale = agent.normalizer.scale()
        self._scale, self._shift = scale.numpy(), (-agent.normalizer.mean * scale).numpy()
        self._normalized = np.empty((len(latent), size), dtype=np.float32)
        self._input = torch.from_numpy(self._normalized)  # the same memory
        offset = first.bias if self._linear else torch.addmm(first.bias, self._latent, first.weight[:, size:].T)
        inputs = 2.0 if rest else 1.0  # of a sigmoid: twice those of the tanh
        self._first = inputs * offset, (inputs * first.weight[:, :size].T).contiguous()
        self._rest = []
        for layer in rest:
            inputs = 1.0 if layer is rest[-1] else 2.0
            bias = inputs * (layer.bias - layer.weight.sum(1))
            self._rest.append((bias, (2.0 * inputs * layer.weight.T).contiguous()))

    def __call__(self, observation: Array) -> Array:
        """Compute deterministic actions: raw observations (N, o) float32 to (N, a)."""
        normalized = self._normalized
        np.multiply(observation, self._scale, out=normalized)
        normalized += self._shift
        np.clip(normalized, -CLIP, CLIP, out=normalized)
        bias, weight = self._first
        x = torch.addmm(bias, self._input, weight)
        for bias, weight in self._rest:
            x = torch.addmm(bias, x.sigmoid_(), weight)
        action: Array = (affine(x, self._latent) if self._linear else x).numpy()
        return action


def windows(observation: Tensor, length: int) -> Tensor:
    """Return the last `length` observations at every step; the first one is repeated if there are fewer.

    Args:
        observation: (T, N, o).
        length: H.

    Returns:
        (T, N, H*o), oldest first.
    """
    steps = torch.arange(observation.shape[0])[:, None] - torch.arange(length - 1, -1, -1)[None]  # (T, H)
    return observation[steps.clamp(min=0)].permute(0, 2, 1, 3).flatten(2)
