"""An artifact as a file and back: which facts lie in the header, which in attributes, which in JSON texts."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from skillcli.errors import StoreError
from skillcli.store import schema
from skillcli.store.artifact import Artifact, Draft, Header, Parent, content_hash
from skillcli.store.container import (
    RECORD,
    Contents,
    checked_arrays,
    pack,
    parse_record,
    peek,
    reading,
    text_array,
    unpack,
)
from skillcli.store.ids import ArtifactId
from skillcli.store.provenance import git_state, package_versions
from skillcli.store.text import canonical, plain, sha256

_HEADER = {
    "id": str,
    "kind": str,
    "schema_version": int,
    "created_utc": str,
    "seed": int,
    "recipe_name": str,
    "parents": list,
    "content_sha256": str,
    "inputs_sha256": str,
    "bytes": int,
}
# Said twice, in the header and as attributes for readers of HDF5: the two must agree.
_SHARED = ("id", "kind", "schema_version", "created_utc", "seed", "content_sha256", "inputs_sha256")
_ATTRIBUTES = {*_SHARED, "recipe_sha256", "model_sha256", "git_commit", "git_dirty"}
_TEXTS = ("command", "recipe", "results", "measured", "packages", "parents")
_RECORDS = {f"{RECORD}/{name}" for name in _TEXTS}
_SHA256 = re.compile(r"[0-9a-f]{64}")
_MAX_TEXT_BYTES = 1 << 20  # JSON takes twenty times its size in memory


def check_draft(draft: Draft) -> Draft:
    """The draft in the form in which it will be stored and read back.

    Raises:
        StoreError: something in it cannot be stored, or does not fit its kind.
    """
    label = f"{draft.name}/{draft.kind}"
    schema.check_kind(draft.kind, label)
    arrays = checked_arrays(draft.arrays)
    schema.check_arrays(draft.kind, {path: array.shape for path, array in arrays.items()}, label)
    if not -(2**63) <= draft.seed < 2**63:
        raise StoreError(f"seed {draft.seed} does not fit in 64 bits", "choose a smaller one")
    texts = {part: plain(getattr(draft, part), part) for part in ("recipe", "results", "measured")}
    return replace(draft, arrays=arrays, seed=int(draft.seed), **texts)


def finish(draft: Draft, version: int, parents: tuple[Parent, ...]) -> Artifact:
    """The artifact that a checked draft becomes under this version number."""
    commit, dirty = git_state()
    artifact = Artifact(
        id=ArtifactId(draft.name, draft.kind, version),
        schema_version=schema.KINDS[draft.kind].version,
        created_utc=datetime.now(UTC).isoformat(timespec="microseconds"),
        seed=draft.seed,
        recipe_name=str(draft.recipe.get("name", "")),
        parents=parents,
        content_sha256="",
        inputs_sha256=draft.inputs_sha256,
        bytes=0,
        command=draft.command,
        recipe=draft.recipe,
        recipe_sha256=sha256(draft.recipe),
        model_sha256=draft.model_sha256,
        git_commit=commit,
        git_dirty=dirty,
        packages=package_versions(),
        results=draft.results,
        measured=draft.measured,
        arrays=draft.arrays,
    )
    return replace(artifact, content_sha256=content_hash(artifact))


def encode(artifact: Artifact) -> memoryview:
    """The bytes of the artifact's file.

    Raises:
        StoreError: they cannot be made.
    """
    header = _header_fields(artifact)
    attributes = {name: header[name] for name in _SHARED} | {
        "recipe_sha256": artifact.recipe_sha256,
        "model_sha256": artifact.model_sha256,
        "git_commit": artifact.git_commit,
        "git_dirty": int(artifact.git_dirty),
    }
    values = {name: getattr(artifact, name) for name in _TEXTS} | {"parents": header["parents"]}
    texts = {f"{RECORD}/{name}": text_array(canonical(value)) for name, value in values.items()}
    _check_texts({path: text.shape for path, text in texts.items()}, str(artifact.id))

    def labels(path: str, ndim: int) -> tuple[str, str]:
        return ("byte", "JSON") if path in texts else schema.labels(artifact.kind, path, ndim)

    return pack(header, Contents(attributes, {**artifact.arrays, **texts}), labels)


def read_header(path: Path, expected: ArtifactId) -> Header:
    """What an artifact's file says of itself, from its first few kilobytes.

    Raises:
        StoreError: it is damaged, of an unknown kind, or not the artifact that its path says.
    """
    fields = peek(path)
    with reading(path):
        return _header(fields, expected)


def read_artifact(path: Path, expected: ArtifactId, *, older: bool = False) -> Artifact:
    """The whole artifact; the file's hash and structure are checked before its data is read.

    Args:
        path: the file.
        expected: which artifact it must be.
        older: whether one of an older schema will do, as it is; its arrays are then compared with no table.

    Raises:
        StoreError: it is damaged, refused, of another schema, or not the artifact that its path says.
    """

    def check(fields: Mapping[str, Any], shapes: Mapping[str, schema.Shape]) -> None:
        header = _header(fields, expected)
        schema.check_not_newer(header.kind, header.schema_version, str(expected))
        outdated = schema.is_older(header.kind, header.schema_version)
        if outdated and not older:
            raise StoreError(
                f"{expected} has the older schema {header.schema_version}",
                f"`skill migrate {expected}` makes a new version of it and keeps the original",
            )
        if missing := _RECORDS - shapes.keys():
            raise ValueError(f"it lacks {', '.join(sorted(missing))}")
        _check_texts(shapes, str(expected))
        if not outdated:
            own = {name: shape for name, shape in shapes.items() if name not in _RECORDS}
            schema.check_arrays(header.kind, own, str(expected))

    fields, contents = unpack(path, check)
    with reading(path):
        return _artifact(_header(fields, expected), contents)


def _check_texts(shapes: Mapping[str, schema.Shape], label: str) -> None:
    total = sum(math.prod(shape) for path, shape in shapes.items() if path in _RECORDS)
    if total > _MAX_TEXT_BYTES:
        raise StoreError(f"{label} has {total} bytes of JSON, at most {_MAX_TEXT_BYTES} fit", "keep lists as arrays")


def _header_fields(header: Header) -> dict[str, Any]:
    fields = {name: getattr(header, name) for name in _HEADER}
    parents = [{"id": str(parent.id), "content_sha256": parent.content_sha256} for parent in header.parents]
    return fields | {"id": str(header.id), "parents": parents}


def _header(fields: Mapping[str, Any], expected: ArtifactId) -> Header:
    """Raises ValueError where the header is not one, and StoreError where it is not for us."""
    if {name: type(value) for name, value in fields.items()} != _HEADER:
        raise ValueError("its header is not that of an artifact")
    schema.check_kind(fields["kind"], str(expected))
    if fields["schema_version"] < 1:
        raise StoreError(f"{expected} has schema {fields['schema_version']}, the first was 1", "it was not made by skill")
    if fields["id"] != str(expected) or fields["kind"] != expected.stage:
        raise StoreError(
            f"the file of {expected} holds {fields['kind']} {fields['id']!r}",
            "it was copied or renamed by hand: move it back",
        )
    if not _SHA256.fullmatch(fields["content_sha256"]):
        raise ValueError("its content hash is not a SHA-256")
    if not (fields["created_utc"].isprintable() and fields["recipe_name"].isprintable()):
        raise ValueError("its header has characters that cannot be printed")
    parents = tuple(Parent(ArtifactId.parse(entry["id"]), str(entry["content_sha256"])) for entry in fields["parents"])
    own = {name: fields[name] for name in _HEADER if name not in ("id", "kind", "parents")}
    return Header(id=expected, parents=parents, **own)


def _artifact(header: Header, contents: Contents) -> Artifact:
    """Raises ValueError where the parts of the file contradict each other."""
    attributes = contents.attributes
    fields = _header_fields(header)
    texts = {name: parse_record(contents, name) for name in _TEXTS}
    different = [name for name in _SHARED if attributes.get(name) != fields[name]]
    different += ["parents"] if texts["parents"] != fields["parents"] else []
    different += ["recipe"] if attributes.get("recipe_sha256") != sha256(texts["recipe"]) else []
    different += sorted(_ATTRIBUTES ^ attributes.keys())
    if different:
        raise ValueError(f"its header and what lies inside disagree about {', '.join(different)}")
    wrong = [name for name in ("recipe", "results", "measured", "packages") if not isinstance(texts[name], dict)]
    if wrong or not isinstance(texts["command"], str):
        raise ValueError(f"{', '.join(wrong) or 'command'} is not what it should be")
    return Artifact(
        **{name: getattr(header, name) for name in _HEADER if name not in ("kind", "parents")},
        parents=header.parents,
        command=texts["command"],
        recipe=texts["recipe"],
        recipe_sha256=str(attributes["recipe_sha256"]),
        model_sha256=str(attributes["model_sha256"]),
        git_commit=str(attributes["git_commit"]),
        git_dirty=bool(attributes["git_dirty"]),
        packages=texts["packages"],
        results=texts["results"],
        measured=texts["measured"],
        arrays={path: array for path, array in contents.arrays.items() if path not in _RECORDS},
    )
