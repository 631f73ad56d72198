"""The whole chain of a recipe, from training to transfer; finished stages with unchanged inputs are reused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skillcli.composition.registry import DEFAULT
from skillcli.evaluation.inputs import compose_inputs, embed_means_inputs, pretrain_inputs, transfer_eval_inputs
from skillcli.evaluation.request import Request, in_its_scene
from skillcli.evaluation.reuse import Elsewhere, finished, of_compose, of_embed_means, of_pretrain, of_transfer_eval
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL
from skillcli.progress import OnProgress, silent
from skillcli.recipe import Recipe
from skillcli.simulation.domains import find_domains
from skillcli.stages.compose import compose
from skillcli.stages.embed_means import embed_means
from skillcli.stages.pretrain import pretrain
from skillcli.stages.transfer_eval import transfer_eval
from skillcli.store import Artifact, Store
from skillcli.tasks.world import World


@dataclass(frozen=True)
class Link:
    """One finished stage of a chain."""

    artifact: Artifact
    reused: bool


def run_chain(
    store: Store,
    recipe: Recipe,
    seed: int,
    name: str,
    command: str,
    on_progress: OnProgress = silent,
    threads: int = 0,
    elsewhere: Elsewhere | None = None,
) -> Iterator[Link]:
    """Run pretrain, embed-means, compose and transfer-eval as the recipe says; yield each when it is finished.

    Args:
        store: to read from and write to.
        recipe: what to run.
        seed: of training and transfer.
        name: first part of the new ids.
        command: as typed, for the record.
        on_progress: called with the progress of each stage.
        threads: of the engine while training, 0 for all cores.
        elsewhere: finished artifacts of other names that may be reused.

    Raises:
        SkillError: one of them fails; earlier ones are kept.
    """
    request = Request.of(in_its_scene(recipe, "", ()), "", ())  # errors of the last stages must show before the first begins
    find_domains(recipe.transfer.domains)
    world = World.of(recipe)
    found = finished(store, PRETRAIN, pretrain_inputs(recipe, world, seed), name, of_pretrain, elsewhere)
    skills = found or pretrain(store, recipe, seed, name, command, True, threads, on_progress)
    yield Link(skills, found is not None)

    found = finished(store, EMBED_MEANS, embed_means_inputs(skills), name, of_embed_means, elsewhere)
    means = found or embed_means(store, skills.id, command, name)
    yield Link(means, found is not None)

    recipe = in_its_scene(recipe, "", ())
    inputs = compose_inputs(means, recipe, world, request, DEFAULT)
    found = finished(store, COMPOSE, inputs, name, of_compose, elsewhere)
    plan = found or compose(store, means.id, recipe, request, DEFAULT, command, name, on_progress)
    yield Link(plan, found is not None)

    domains, episodes = recipe.transfer.domains, recipe.transfer.episodes
    inputs = transfer_eval_inputs(plan, recipe, domains, episodes, seed)

    def of_transfer(one: Artifact, world: World) -> str:
        return of_transfer_eval(one, world, domains, episodes)

    found = finished(store, TRANSFER_EVAL, inputs, name, of_transfer, elsewhere)
    transfer = found or transfer_eval(store, plan.id, recipe, domains, episodes, seed, command, name, on_progress)
    yield Link(transfer, found is not None)
