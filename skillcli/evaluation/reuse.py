"""Find finished work that can be reused.

A header only claims the inputs of an artifact. Here they are computed again from its own recipe, seed and parents.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from skillcli.errors import SkillError, UnknownArtifact
from skillcli.evaluation.consistency import check_meaning, stored_recipe
from skillcli.evaluation.inputs import compose_inputs, embed_means_inputs, pretrain_inputs, transfer_eval_inputs
from skillcli.evaluation.request import Request
from skillcli.evaluation.transfer_evaluator import TargetRobots
from skillcli.kinds import COMPOSE, TRANSFER_EVAL, AnyKind
from skillcli.kinds.compose import GOALS
from skillcli.simulation.domains import find_domains
from skillcli.store import Artifact, ArtifactId, Store, content_hash
from skillcli.tasks.world import World
from skillcli.trajectories import Array

Inputs = Callable[[Artifact, World], str]
Elsewhere = Mapping[tuple[str, str], Sequence[ArtifactId]]
"""Artifacts of a store by kind and claimed inputs, whatever their names, newest first."""


def by_inputs(store: Store) -> Elsewhere:
    """Read which inputs the artifacts of a store claim, all at once."""
    found: dict[tuple[str, str], list[ArtifactId]] = {}
    for header in reversed(store.headers()):
        if header.inputs_sha256:
            found.setdefault((header.kind, header.inputs_sha256), []).append(header.id)
    return found


def finished(
    store: Store, kind: AnyKind, inputs: str, name: str, inputs_of: Inputs, elsewhere: Elsewhere | None = None
) -> Artifact | None:
    """Find the newest artifact that was made from exactly these inputs, under a name or, where it is allowed, elsewhere.

    Args:
        store: where to look.
        kind: of the artifact.
        inputs: fingerprint of everything that the work depends on.
        name: first part of its id.
        inputs_of: computes the fingerprint from an artifact's content and the world of its recipe; "" if it cannot.
        elsewhere: artifacts of other names that will do as well, those under the name first.

    Raises:
        StoreError: an artifact that claims these inputs cannot be read.
    """
    for one in dict.fromkeys([*store.find(kind.name, inputs, name), *(elsewhere or {}).get((kind.name, inputs), ())]):
        try:
            artifact = store.read(one)
        except UnknownArtifact:  # removed meanwhile
            continue
        if content_hash(artifact) == artifact.content_sha256 and _really(artifact, inputs_of) == inputs:
            return artifact
    return None


def _really(artifact: Artifact, inputs_of: Inputs) -> str:
    try:
        check_meaning(artifact)
        world = World.of(stored_recipe(artifact))
        return inputs_of(artifact, world) if artifact.model_sha256 == world.fingerprint else ""
    except SkillError:
        return ""


def of_pretrain(artifact: Artifact, world: World) -> str:
    """Compute the fingerprint of a training."""
    return pretrain_inputs(stored_recipe(artifact), world, artifact.seed)


def of_embed_means(artifact: Artifact, _: World) -> str:
    """Compute the fingerprint of means."""
    return embed_means_inputs(artifact.parents[0]) if artifact.parents else ""


def of_compose(artifact: Artifact, world: World) -> str:
    """Compute the fingerprint of a plan made in the nominal simulation."""
    results, arrays = COMPOSE.results_of(artifact), artifact.arrays
    if not artifact.parents or results.on:
        return ""
    target, route = arrays["waypoints/target"], arrays["waypoints/route"]
    routes = tuple(target[route == index] for index in range(results.routes))
    request = Request("" if results.task == GOALS else results.task, routes)
    return compose_inputs(artifact.parents[0], stored_recipe(artifact), world, request, results.method, artifact.seed)


def of_transfer_eval(artifact: Artifact, world: World, domains: Sequence[str], episodes: int) -> str:
    """Compute the fingerprint of a transfer of the skills' own robot; the drawn parameters identify the domains."""
    results, found = TRANSFER_EVAL.results_of(artifact), find_domains(domains)
    named = [domain.name for domain in results.domains] == [domain.name for domain in found]
    if not artifact.parents or not named or results.robot:
        return ""
    for domain in found:
        drawn = TargetRobots.drawn(domain, episodes, artifact.seed, world.joints).parameters
        if not _begins(artifact.group(f"domains/{domain.name}"), drawn):
            return ""
    sensitivity = any(domain.sensitivity is not None for domain in results.domains)
    return transfer_eval_inputs(
        artifact.parents[0], stored_recipe(artifact), domains, episodes, artifact.seed, sensitivity=sensitivity
    )


def _begins(stored: Mapping[str, Array], drawn: Mapping[str, Array]) -> bool:
    """Return whether the stored robots equal the drawn ones; if all are the same, the first ones suffice."""
    if stored.keys() != drawn.keys():
        return False
    pairs = [(stored[name], values) for name, values in drawn.items()]
    same = all((values == values[:1]).all() for _, values in pairs)
    return all(np.array_equal(rows, values[: len(rows)] if same else values) for rows, values in pairs)
