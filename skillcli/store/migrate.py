"""From older schemas to the present one: one function per kind and version, applied one after the other in one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from skillcli.errors import StoreError
from skillcli.store.artifact import ORIGIN, Array, Artifact, Draft
from skillcli.store.schema import KINDS

Arrays = dict[str, Array]
Results = dict[str, Any]


def _embed_means_1(arrays: Arrays, results: Results) -> tuple[Arrays, Results]:
    """Version 2 also plays the latents half-way between two skills; the older had none."""
    return {**arrays, "halfway/pair": np.zeros((0, 2), dtype=np.int64)}, {**results, "halfway": []}


def _compose_1(arrays: Arrays, results: Results) -> tuple[Arrays, Results]:
    """Version 2 has several routes, each run from the start; before, there was one."""
    routes = {
        f"{folder}/route": np.zeros(len(arrays[field]), dtype=np.int64)
        for folder, field in (("plan", "plan/latent"), ("waypoints", "waypoints/target"))
    }
    routed = {part: [{**entry, "route": 0} for entry in results.get(part, [])] for part in ("segments", "waypoints")}
    added = {
        "routes": 1,
        "success_rate": float(arrays["trajectories/success"].mean()),
        "final_distances_m": [results["final_distance_m"]],
    }
    return {**arrays, **routes}, {**results, **routed, **added}


STEPS: Mapping[tuple[str, int], Callable[[Arrays, Results], tuple[Arrays, Results]]] = {
    ("embed-means", 1): _embed_means_1,
    ("compose", 1): _compose_1,
}
"""From which kind and version each function leads to the next version."""


def brought_up(old: Artifact) -> tuple[Arrays, Results]:
    """Arrays and results of an artifact in the present schema, whatever its own is.

    Raises:
        StoreError: it lacks what it should hold.
    """
    arrays, results = dict(old.arrays), dict(old.results)
    try:
        for before in range(old.schema_version, KINDS[old.kind].version):
            arrays, results = STEPS[old.kind, before](arrays, results)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(f"{old.id} is not what schema {old.schema_version} says: {error!r}", "make it anew") from error
    return arrays, results


def migrated(old: Artifact, command: str) -> Draft:
    """An artifact of an older schema in the present one, as a new version of the same series.

    Raises:
        StoreError: it has the present schema, or lacks what it should hold.
    """
    version = KINDS[old.kind].version
    if old.schema_version >= version:
        raise StoreError(f"{old.id} has the present schema, {version}", "it can be used as it is")
    arrays, results = brought_up(old)
    origin = {
        "id": str(old.id),
        "content_sha256": old.content_sha256,
        "schema_version": old.schema_version,
        "created_utc": old.created_utc,
        "command": old.command,
        "git_commit": old.git_commit,
        "packages": dict(old.packages),
    }
    return Draft(
        kind=old.kind,
        name=old.id.name,
        seed=old.seed,
        command=command,
        recipe=old.recipe,
        arrays=arrays,
        results=results,
        measured={**old.measured, ORIGIN: origin},
        parents=[parent.id for parent in old.parents],
        model_sha256=old.model_sha256,
        inputs_sha256=old.inputs_sha256,
    )
