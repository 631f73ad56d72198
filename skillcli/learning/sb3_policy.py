"""Read the policy of a Stable-Baselines3 file without running anything that is in it.

Such a file is a zip. Loading it with Stable-Baselines3 unpickles parts of it, and a pickle may run any program. Here only two
members are read: `policy.pth`, by torch's loader that accepts nothing but numbers, and of `data` the plain text that names the
activation function.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch

from skillcli.errors import UsageError
from skillcli.paths import read_small
from skillcli.trajectories import Array

MAX_BYTES = 1 << 26  # larger than the file of any small network
MLP = "train with policy MlpPolicy, and save with model.save(FILE)"
ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "Tanh": np.tanh,
    "ReLU": lambda x: np.maximum(x, 0.0),
    "ELU": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0.0))),
}
# name of an algorithm's hidden layers, of its last layer, its default activation, and whether a tanh bounds the output
FORMS = {
    "PPO or A2C": ("mlp_extractor.policy_net", "action_net", "Tanh", False),
    "SAC": ("actor.latent_pi", "actor.mu", "ReLU", True),
    "TD3 or DDPG": ("actor.mu", "", "ReLU", True),
}


@dataclass(frozen=True, eq=False)
class Policy:
    """A multilayer perceptron from features to actions without noise, in [-1, 1]."""

    layers: tuple[tuple[Array, Array], ...]  # weight (out, in) and bias (out,) of each
    activation: str
    bounded: bool  # whether a tanh follows the last layer; else actions are clipped

    @property
    def sizes(self) -> tuple[int, int]:
        """Return how many features it takes, and how many numbers an action has."""
        return self.layers[0][0].shape[1], self.layers[-1][0].shape[0]

    def __call__(self, features: Array) -> Array:
        """Compute actions: (N, f) to (N, d)."""
        x: Array = np.asarray(features, dtype=np.float32)
        for weight, bias in self.layers[:-1]:
            x = ACTIVATIONS[self.activation](x @ weight.T + bias)
        weight, bias = self.layers[-1]
        x = x @ weight.T + bias
        return np.tanh(x) if self.bounded else np.clip(x, -1.0, 1.0)

    def arrays(self) -> dict[str, Array]:
        """Return every weight by name."""
        return {
            f"policy.{layer}.{name}": array
            for layer, pair in enumerate(self.layers)
            for name, array in zip(("weight", "bias"), pair, strict=True)
        }


def read_policy(path: Path, digest: str) -> Policy:
    """Read the policy of a file with this SHA-256.

    Raises:
        UsageError: it is another file, or none that Stable-Baselines3 wrote, or its policy is no multilayer perceptron.
    """
    try:
        content = read_small(path, MAX_BYTES)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {getattr(error, 'strerror', '') or error}", MLP) from None
    if hashlib.sha256(content).hexdigest() != digest:
        raise UsageError(f"{path} is not the file that the settings name: its SHA-256 differs", "give it by --method sb3:FILE")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            weights = torch.load(io.BytesIO(_member(archive, "policy.pth")), map_location="cpu", weights_only=True)
            data = json.loads(_member(archive, "data"))
        arrays = {name: tensor.numpy() for name, tensor in weights.items()}
    except UsageError:
        raise
    except Exception as error:  # a foreign file may break any of the readers
        raise UsageError(f"{path} is not a model that Stable-Baselines3 saved: {type(error).__name__}", MLP) from None
    return _policy(path, arrays, _activation(data))


def _policy(path: Path, arrays: dict[str, Array], activation: str) -> Policy:
    for algorithm, (hidden, last, usual, bounded) in FORMS.items():
        layers = _layers(arrays, hidden) + ([_pair(arrays, last)] if last and f"{last}.weight" in arrays else [])
        if not layers or (last and f"{last}.weight" not in arrays):
            continue
        if any(name.startswith("features_extractor") for name in arrays):
            break
        sizes = [weight.shape for weight, _ in layers]
        if any(after[1] != before[0] for before, after in pairwise(sizes)):
            raise UsageError(f"{path}: the layers of this {algorithm} policy do not fit each other", MLP)
        if not all(np.isfinite(array).all() for pair in layers for array in pair):
            raise UsageError(f"{path}: a weight is not finite", "its training diverged: train anew")
        return Policy(tuple(layers), activation or usual, bounded)
    raise UsageError(f"{path}: expected the multilayer perceptron of {', '.join(FORMS)}", MLP)


def _layers(arrays: dict[str, Array], name: str) -> list[tuple[Array, Array]]:
    numbers = sorted(int(found[1]) for key in arrays if (found := re.fullmatch(rf"{re.escape(name)}\.(\d+)\.weight", key)))
    return [_pair(arrays, f"{name}.{number}") for number in numbers]


def _pair(arrays: dict[str, Array], name: str) -> tuple[Array, Array]:
    return arrays[f"{name}.weight"], arrays[f"{name}.bias"]


def _activation(data: Any) -> str:
    """Return the activation function that the settings name in plain text; "" for the algorithm's own."""
    chosen = data.get("policy_kwargs") if isinstance(data, dict) else None
    text = str(chosen.get("activation_fn", "")) if isinstance(chosen, dict) else ""
    name = re.sub(r".*\.(\w+)'>$", r"\1", text)
    if name and name not in ACTIVATIONS:
        raise UsageError(f"the policy's activation function is {name}", f"known ones: {', '.join(ACTIVATIONS)}")
    return name


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).file_size > MAX_BYTES:
        raise UsageError(f"{name} in the file is larger than {MAX_BYTES:,} bytes", MLP)
    return archive.read(name)
