"""Parts shared by learned composers: networks from features, and a round of choices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from skillcli.errors import SkillError
from skillcli.learning.networks import Normalizer, mlp
from skillcli.trajectories import Array


class Trace:
    """A round of N episodes: features, choices and rewards, choice after choice."""

    def __init__(self) -> None:
        self.seen: list[Array] = []  # features (N, f), one more than choices
        self.units: list[Array] = []  # chosen, (N, d)
        self.rewards: list[Array] = []  # (N,)
        self.terminated: list[Array] = []  # (N,)

    def chose(self, features: Array, unit: Array) -> None:
        """Record a choice; its features are new only for the first one."""
        if not self.seen:
            self.seen.append(features)
        self.units.append(unit)

    def observe(self, reward: Array, features: Array, terminated: Array) -> None:
        """Record the outcome of the last choice."""
        self.seen.append(features)
        self.rewards.append(reward)
        self.terminated.append(terminated)


class Head(nn.Module):
    """A multilayer perceptron, with a final tanh if its output must be within [-1, 1]."""

    def __init__(
        self, inputs: int, hidden: Sequence[int], outputs: int, bounded: bool, gain: float, make: torch.Generator
    ) -> None:
        super().__init__()
        self.body = mlp([inputs, *hidden, outputs], gain, make)
        self.bounded = bounded

    def forward(self, *parts: Tensor) -> Tensor:
        """Join parts (..., n_i) and compute (..., outputs)."""
        out: Tensor = self.body(torch.cat(parts, -1))
        return out.tanh() if self.bounded else out


def arrays_of(**modules: nn.Module) -> dict[str, Array]:
    """Return every weight of some modules by name: "actor.body.0.weight"."""
    return {
        f"{module}.{name}": tensor.detach().numpy().copy()
        for module, found in modules.items()
        for name, tensor in found.state_dict().items()
    }


def tensor(array: Array) -> Tensor:
    """Convert to float32."""
    return torch.as_tensor(array, dtype=torch.float32)


def check_finite(method: str, logged: Mapping[str, float], *modules: nn.Module) -> None:
    """Refuse to continue with numbers that are not finite.

    Raises:
        SkillError: a logged number or a weight is not finite.
    """
    not_finite = [name for name, number in logged.items() if not math.isfinite(number)]
    if not all(bool(torch.isfinite(weight).all()) for module in modules for weight in module.parameters()):
        not_finite.append("weights")
    if not_finite:
        raise SkillError(
            f"training of the {method} composer diverged: {', '.join(not_finite)} not finite",
            f"lower {method}.learning_rate or {method}.reward_scale",
        )


__all__ = ["Head", "Normalizer", "Trace", "arrays_of", "check_finite", "tensor"]
