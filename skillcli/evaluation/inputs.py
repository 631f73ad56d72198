"""Fingerprints of all inputs of a stage, by which finished work is recognised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillcli.composition.registry import all_specs, method_spec, replanning
from skillcli.errors import UsageError
from skillcli.evaluation.library import TRAINED, fingerprint
from skillcli.evaluation.request import Request
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL
from skillcli.recipe import Recipe
from skillcli.robots.robot import Robot
from skillcli.simulation.domains import find_domain, find_domains
from skillcli.store import Artifact, Parent
from skillcli.tasks.world import World

DRAWN = "each episode by itself, what repeats once"  # how robots are drawn; results drawn in another way are not reused


def robots_for(recipe: Recipe, world: World, method: str, on: str, seed: int) -> SampledRobots:
    """Return the robots on which a method tries latents; `world` is that of the recipe.

    Raises:
        UsageError: the domain is unknown, or the method tries no latents.
    """
    spec = method_spec(method)
    if on and not spec.on_target:
        able = ", ".join(name for name, other in all_specs().items() if other.on_target)
        raise UsageError(f"--method {method} tries no latents, so it cannot plan on a domain", f"--on goes with {able}")
    settings = recipe.compose if spec.ensemble else recipe.compose.model_copy(update={"ensemble": 0})
    return SampledRobots.of(settings, on, seed, world.joints)


def pretrain_inputs(recipe: Recipe, world: World, seed: int) -> str:
    """Return the fingerprint of a training; `world` is that of the recipe."""
    return fingerprint(PRETRAIN.name, [recipe.fingerprint(TRAINED), seed, world.fingerprint])


def embed_means_inputs(source: Artifact | Parent) -> str:
    """Return the fingerprint of the means of a training."""
    return fingerprint(EMBED_MEANS.name, [source.content_sha256])


def compose_inputs(
    source: Artifact | Parent, recipe: Recipe, world: World, request: Request, method: str, seed: int = 0, on: str = ""
) -> str:
    """Return the fingerprint of a composition; `world` is that of the recipe."""
    others = find_domain(recipe.compose.robots)
    parts: list[Any] = [
        source.content_sha256,
        method,
        recipe.fingerprint(method_spec(method).sections),
        request.task,
        request.waypoints,
        request.route,
        {"predicted": [others.name, str(sorted(others.parameters.items()))]},
    ]
    parts += [getattr(recipe.task, key) for key in (*recipe.task.SCENE, *recipe.task.JUDGED)]
    robots = robots_for(recipe, world, method, on, seed)
    if robots.parameters or on:
        parts += [seed, on, {name: values.tolist() for name, values in robots.parameters.items()}]
    return fingerprint(COMPOSE.name, [*parts, seed] if method_spec(method).draws else parts)


def transfer_eval_inputs(
    source: Artifact | Parent,
    recipe: Recipe,
    domains: Sequence[str],
    episodes: int,
    seed: int,
    robot: Robot | None = None,
    sensitivity: bool = False,
) -> str:
    """Return the fingerprint of a transfer."""
    tables = [[domain.name, str(sorted(domain.parameters.items()))] for domain in find_domains(domains)]
    replanned = recipe.fingerprint(["transfer", "compose", *replanning()]) if recipe.transfer.replan else ""
    judged = [getattr(recipe.task, key) for key in recipe.task.JUDGED]
    parts: list[Any] = [source.content_sha256, tables, episodes, seed, replanned, DRAWN, judged]
    if robot is not None:
        parts.append({"robot": robot.fingerprint})
    if sensitivity:
        parts.append("sensitivity")
    return fingerprint(TRANSFER_EVAL.name, parts)
