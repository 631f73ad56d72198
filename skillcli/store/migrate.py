"""Migrate from older schemas to the present one: apply a kind's migrations one after another."""

from __future__ import annotations

from skillcli.errors import StoreError
from skillcli.kinds import KINDS
from skillcli.kinds.spec import Arrays, Results
from skillcli.store.artifact import ORIGIN, Artifact, Draft


def brought_up(old: Artifact) -> tuple[Arrays, Results]:
    """Return arrays and results of an artifact in the present schema.

    Raises:
        StoreError: a required part is missing.
    """
    arrays, results, spec = dict(old.arrays), dict(old.results), KINDS[old.kind]
    try:
        for before in range(old.schema_version, spec.version):
            arrays, results = spec.migrations[before](arrays, results)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(f"{old.id} is not what schema {old.schema_version} says: {error!r}", "make it anew") from error
    return arrays, results


def migrated(old: Artifact, command: str) -> Draft:
    """Return an artifact of an older schema in the present one, as a new version of the same series.

    Raises:
        StoreError: it has the present schema, or a required part is missing.
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
