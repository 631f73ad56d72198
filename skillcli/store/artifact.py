"""`Draft`, which a stage gives to the store, and `Artifact`, which the store returns."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillcli.plaintext import code, markdown
from skillcli.store.canonical_json import canonical
from skillcli.store.ids import ArtifactId

Array = NDArray[Any]

ORIGIN = "migrated_from"
"""Key in `measured`, which is not hashed, under which a migrated artifact names its original."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Draft:
    """A finished result without an id."""

    kind: str
    name: str  # first part of the id
    seed: int
    command: str  # as typed
    recipe: Mapping[str, Any]  # resolved; has a "name"
    arrays: Mapping[str, Array]  # by path, see schema.py
    results: Mapping[str, Any]  # results of the stage: part of the content hash; NaN is stored as null
    measured: Mapping[str, Any]  # what differs between equal runs, such as times: not hashed
    parents: Sequence[ArtifactId] = ()
    model_sha256: str = ""
    inputs_sha256: str = ""  # fingerprint of everything that determines the result, to recognise finished work


@dataclass(frozen=True)
class Parent:
    """An artifact that another was made from, with its content hash at that time."""

    id: ArtifactId
    content_sha256: str


@dataclass(frozen=True, kw_only=True)
class Header:
    """The part of an artifact that can be read without its data."""

    id: ArtifactId
    schema_version: int
    created_utc: str  # ISO 8601 with microseconds, sorts by time
    seed: int
    recipe_name: str
    parents: tuple[Parent, ...]
    content_sha256: str
    inputs_sha256: str
    bytes: int  # size of the file

    @property
    def kind(self) -> str:
        """Return the kind: the stage that made it."""
        return self.id.stage


@dataclass(frozen=True, kw_only=True, eq=False)
class Artifact(Header):
    """One artifact in memory."""

    command: str
    recipe: Mapping[str, Any]
    recipe_sha256: str
    model_sha256: str
    git_commit: str
    git_dirty: bool
    packages: Mapping[str, str]
    results: Mapping[str, Any]
    measured: Mapping[str, Any]
    arrays: Mapping[str, Array] = field(repr=False)

    def group(self, prefix: str) -> dict[str, Array]:
        """Return the arrays below `prefix`, keyed by the rest of their path: `group("trajectories")["time"]`."""
        start = prefix.rstrip("/") + "/"
        return {path.removeprefix(start): array for path, array in self.arrays.items() if path.startswith(start)}

    @property
    def origin(self) -> Mapping[str, Any]:
        """Return the original of a migrated artifact: id, content_sha256, command and more; empty for any other."""
        found = self.measured.get(ORIGIN)
        return found if isinstance(found, dict) and {"id", "content_sha256", "command"} <= found.keys() else {}

    @property
    def robot(self) -> str:
        """Return the robot as the recipe names it; "" if it names none: it is the default one, or there is no arm."""
        return str(self.recipe.get("robot", ""))

    def provenance(self) -> str:
        """Describe the origin as markdown."""
        origin = self.origin
        lines = [
            f"# {markdown(str(self.id))}",
            "",
            code(self.command),
            "",
            f"- recipe **{markdown(self.recipe_name)}**, seed **{self.seed}**",
            *([f"- robot **{markdown(self.robot)}**"] if self.robot else []),
            f"- made {markdown(self.created_utc[:19])} UTC",
            f"- content {code(self.content_sha256[:16])}",
            f"- git {code(self.git_commit[:12] or 'unknown')}{' with changes' if self.git_dirty else ''}",
            *(f"- made from **{markdown(str(parent.id))}** {code(parent.content_sha256[:16])}" for parent in self.parents),
            *([f"- migrated from **{markdown(str(origin['id']))}**, made by {code(str(origin['command']))}"] if origin else []),
            "",
            "| package | version |",
            "|---|---|",
            *(f"| {markdown(package)} | {markdown(version)} |" for package, version in sorted(self.packages.items())),
        ]
        return "\n".join(lines)


@dataclass(frozen=True)
class Unreadable:
    """A file in the place of an artifact that cannot be read, or a folder that cannot be listed."""

    id: ArtifactId | str  # or the folder `NAME/`
    problem: str


def content_hash(artifact: Artifact) -> str:
    """Hash data and meaning with SHA-256: equal for equal runs, whatever their names, times, machines and speeds."""
    meaning = {
        "kind": artifact.kind,
        "schema_version": artifact.schema_version,
        "seed": artifact.seed,
        "recipe_sha256": artifact.recipe_sha256,
        "parents": [parent.content_sha256 for parent in artifact.parents],
        "model_sha256": artifact.model_sha256,
        "results": artifact.results,
    }
    sha = hashlib.sha256(canonical(meaning).encode())
    for path, array in sorted(artifact.arrays.items()):
        sha.update(f"\n{canonical([path, array.dtype.str, list(array.shape)])}\n".encode())
        sha.update(np.ascontiguousarray(array).data)
    return sha.hexdigest()
