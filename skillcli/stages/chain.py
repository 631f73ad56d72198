"""The whole chain of a recipe, from training to pictures; what is finished and unchanged is used again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skillcli.progress import Report, silent
from skillcli.recipe import Recipe
from skillcli.simulation.domains import find_domains
from skillcli.stages import compose as composing
from skillcli.stages import embed_means as embedding
from skillcli.stages import pretrain as training
from skillcli.stages import transfer_eval as transferring
from skillcli.stages.reuse import finished, of_compose, of_embed_means, of_pretrain, of_transfer_eval
from skillcli.store import Artifact, Store


@dataclass(frozen=True)
class Link:
    """One stage of a chain, done."""

    artifact: Artifact
    reused: bool


def run_chain(store: Store, recipe: Recipe, seed: int, name: str, command: str, report: Report = silent) -> Iterator[Link]:
    """Pretrain, embed-means, compose and transfer-eval as the recipe says, each yielded when it is there.

    Raises:
        SkillError: any of them fails; those before it stay.
    """
    request = composing.Request.of(recipe, "", ())  # what is wrong with the last stages is said before the first
    find_domains(recipe.transfer.domains)
    found = finished(store, "pretrain", training.inputs_of(recipe, seed), name, of_pretrain)
    skills = found or training.pretrain(store, recipe, seed, name, command, resume=True, report=report)
    yield Link(skills, found is not None)

    found = finished(store, "embed-means", embedding.inputs_of(skills), name, of_embed_means)
    means = found or embedding.embed_means(store, skills.id, command)
    yield Link(means, found is not None)

    inputs = composing.inputs_of(means, recipe, request, "search")
    found = finished(store, "compose", inputs, name, of_compose)
    plan = found or composing.compose(store, means.id, recipe, request, "search", command, report=report)
    yield Link(plan, found is not None)

    domains, episodes = recipe.transfer.domains, recipe.transfer.episodes
    inputs = transferring.inputs_of(plan, recipe, domains, episodes, seed)
    found = finished(store, "transfer-eval", inputs, name, lambda one: of_transfer_eval(one, domains, episodes))
    transfer = found or transferring.transfer_eval(store, plan.id, recipe, domains, episodes, seed, command, report=report)
    yield Link(transfer, found is not None)
