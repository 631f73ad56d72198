"""Compute the sizes of all networks of a skill library without building them, however large a recipe asks for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from skillcli.learning.settings import LearningRecipe

Shape = tuple[int, ...]


def weight_shapes(recipe: LearningRecipe, observation: int, action: int, privileged: int) -> dict[str, Shape]:
    """Return the shape of every weight of `skillcli.learning.agent.Agent` by its dotted name.

    Args:
        recipe: gives the hidden layers, the latent space and the skills.
        observation: size o.
        action: size a.
        privileged: size p of the value function's own observations.
    """
    embedding, network, skills = recipe.embedding, recipe.network, len(recipe.task.goals)
    latent, linear = embedding.size, network.linear_latent
    ends = (observation, action * (1 + latent)) if linear else (observation + latent, action)
    value_inputs = observation + privileged + latent + skills
    return {
        **_normalizer("normalizer", observation),
        **(_normalizer("privileged_normalizer", privileged) if privileged else {}),
        "policy.log_std": (action,),
        **_mlp("policy", [ends[0], *network.policy_hidden, ends[1]]),
        "embedding.raw_mean": (skills, latent),
        "embedding.raw_std": (skills, latent),
        **_mlp("inference", [embedding.window * observation, *network.inference_hidden, 2 * latent]),
        **_mlp("value", [value_inputs, *network.value_hidden, 1]),
    }


def _normalizer(name: str, size: int) -> dict[str, Shape]:
    return {f"{name}.mean": (size,), f"{name}.variance": (size,), f"{name}.count": ()}


def _mlp(name: str, sizes: Sequence[int]) -> dict[str, Shape]:
    """Return the shapes of linear layers with a tanh after each but the last: every second module has weights."""
    shapes: dict[str, Shape] = {}
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        shapes |= {f"{name}.body.{2 * layer}.weight": (fan_out, fan_in), f"{name}.body.{2 * layer}.bias": (fan_out,)}
    return shapes
