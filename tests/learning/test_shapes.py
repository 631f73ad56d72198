"""Sizes of all networks, counted by hand: 10 observed, 2 actions, 2 latents, 4 skills, windows of 3."""

from __future__ import annotations

from typing import Any

from skillcli.learning.shapes import weight_shapes
from skillcli.recipe import resolve


def shapes(privileged: int, **network: Any) -> dict[str, tuple[int, ...]]:
    sizes = {"policy_hidden": [5, 4], "inference_hidden": [6], "value_hidden": [7], **network}
    recipe = resolve({"name": "any", "task": {"name": "point"}, "embedding": {"size": 2, "window": 3}, "network": sizes})
    return weight_shapes(recipe, observation=10, action=2, privileged=privileged)


def test_every_weight_has_the_shape_that_its_inputs_and_outputs_ask_for() -> None:
    assert shapes(privileged=1) == {
        "normalizer.mean": (10,),
        "normalizer.variance": (10,),
        "normalizer.count": (),
        "privileged_normalizer.mean": (1,),
        "privileged_normalizer.variance": (1,),
        "privileged_normalizer.count": (),
        "policy.log_std": (2,),
        "policy.body.0.weight": (5, 12),  # observation and latent
        "policy.body.0.bias": (5,),
        "policy.body.2.weight": (4, 5),
        "policy.body.2.bias": (4,),
        "policy.body.4.weight": (2, 4),
        "policy.body.4.bias": (2,),
        "embedding.raw_mean": (4, 2),
        "embedding.raw_std": (4, 2),
        "inference.body.0.weight": (6, 30),  # three observations
        "inference.body.0.bias": (6,),
        "inference.body.2.weight": (4, 6),  # mean and std of two latents
        "inference.body.2.bias": (4,),
        "value.body.0.weight": (7, 17),  # observation, privileged, latent, skill
        "value.body.0.bias": (7,),
        "value.body.2.weight": (1, 7),
        "value.body.2.bias": (1,),
    }


def test_without_privileged_inputs_nothing_normalizes_them() -> None:
    found = shapes(privileged=0)
    assert found["value.body.0.weight"] == (7, 16) and not any(name.startswith("privileged") for name in found)


def test_a_policy_that_is_affine_in_the_latent_sees_none_and_gives_three_actions_for_one() -> None:
    found = shapes(privileged=0, linear_latent=True)
    assert found["policy.body.0.weight"] == (5, 10) and found["policy.body.4.weight"] == (6, 4)
