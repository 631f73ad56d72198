"""Encode an artifact as a file and back: which facts are in the header, in attributes, and in JSON texts."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from skillcli.errors import StoreError
from skillcli.kinds import KINDS, kind_spec
from skillcli.store import schema, validation
from skillcli.store.artifact import Artifact, Draft, Header, Parent, content_hash
from skillcli.store.canonical_json import canonical, plain, sha256
from skillcli.store.container import RECORD, Contents, checked_arrays, pack, parse_record, peek, reading, text_array, unpack
from skillcli.store.ids import ArtifactId
from skillcli.store.provenance import git_state, package_versions

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
# Stored twice, in the header and as attributes for other HDF5 readers: both must agree.
_SHARED = ("id", "kind", "schema_version", "created_utc", "seed", "content_sha256", "inputs_sha256")
_ATTRIBUTES = {*_SHARED, "recipe_sha256", "model_sha256", "git_commit", "git_dirty"}
_SHA256 = re.compile(r"[0-9a-f]{64}")
_TIME = re.compile(r"20[0-9]{2}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\.[0-9]{6}\+00:00", re.ASCII)
_RECIPE_NAME = re.compile(r"[A-Za-z0-9._-]{0,64}", re.ASCII)
_ATTRIBUTE_FORMS = {
    "recipe_sha256": _SHA256,
    "model_sha256": re.compile(r"[0-9a-z]{0,64}", re.ASCII),
    "git_commit": re.compile(r"[0-9a-f]{0,64}", re.ASCII),
}
# Largest JSON texts, bytes: a parsed text takes about twenty times its size in memory; they are for people, data are arrays.
_MAX_TEXT_BYTES = {
    "command": 1 << 16,
    "recipe": 1 << 18,
    "results": 1 << 20,
    "measured": 1 << 16,
    "packages": 1 << 13,
    "parents": 1 << 16,
}
_TEXTS = tuple(_MAX_TEXT_BYTES)
_RECORDS = {f"{RECORD}/{name}" for name in _TEXTS}
MAX_PARENTS = 256  # of any artifact; `schema` has the number for each kind
_MAX_COMMAND = 8000  # characters kept of a longer command


def check_draft(draft: Draft) -> Draft:
    """Return the draft in the form in which it will be stored and read back.

    Raises:
        StoreError: something in it cannot be stored, or does not fit its kind.
    """
    label = f"{draft.name}/{draft.kind}"
    kind_spec(draft.kind, label)
    arrays = checked_arrays(draft.arrays)
    schema.check_arrays(draft.kind, {path: array.shape for path, array in arrays.items()}, label)
    if not 0 <= draft.seed < 2**63:
        raise StoreError(f"seed {draft.seed} is not between 0 and 2**63 - 1", "choose another one")
    texts = {part: plain(getattr(draft, part), part) for part in ("recipe", "results", "measured")}
    return replace(draft, arrays=arrays, seed=int(draft.seed), command=draft.command[:_MAX_COMMAND], **texts)


def finish(draft: Draft, version: int, parents: tuple[Parent, ...]) -> Artifact:
    """Make the artifact of a checked draft with this version number."""
    commit, dirty = git_state()
    artifact = Artifact(
        id=ArtifactId(draft.name, draft.kind, version),
        schema_version=KINDS[draft.kind].version,
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
    """Encode the artifact as the bytes of its file.

    Raises:
        StoreError: that fails.
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

    return pack(header, Contents(attributes, {**artifact.arrays, **texts}), partial(_labels, artifact.kind))


def read_header(path: Path | str, expected: ArtifactId) -> Header:
    """Read the header of an artifact from the first few kilobytes of its file.

    Raises:
        StoreError: it is damaged, of an unknown kind, or of another artifact than its path says.
    """
    fields = peek(path)
    with reading(path):
        return _header(fields, expected)


def read_artifact(path: Path, expected: ArtifactId, *, older: bool = False) -> Artifact:
    """Read the whole artifact; hash and structure of the file are checked before its data is read.

    Args:
        path: the file.
        expected: which artifact it must be.
        older: whether to accept an older schema as it is; its arrays are then not checked against the kind.

    Raises:
        StoreError: it is damaged, refused, of another schema, or of another artifact than its path says.
    """

    def check(fields: Mapping[str, Any], shapes: Mapping[str, schema.Shape], labels: Mapping[str, tuple[str, str]]) -> None:
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
            _check_labels(header.kind, shapes, labels)

    fields, contents = unpack(path, check)
    with reading(path):
        artifact = _artifact(_header(fields, expected), contents)
    return validation.checked(artifact)


def _labels(kind: str, path: str, ndim: int) -> tuple[str, str]:
    return ("byte", "JSON") if path in _RECORDS else schema.labels(kind, path, ndim)


def _check_labels(kind: str, shapes: Mapping[str, schema.Shape], labels: Mapping[str, tuple[str, str]]) -> None:
    for path, shape in shapes.items():
        if labels[path] != (wanted := _labels(kind, path, len(shape))):
            raise ValueError(f"{path} is labelled {labels[path]}, expected {wanted}")


def _check_texts(shapes: Mapping[str, schema.Shape], label: str) -> None:
    for name, limit in _MAX_TEXT_BYTES.items():
        size = math.prod(shapes[f"{RECORD}/{name}"])
        if size > limit:
            raise StoreError(f"{label} has {size} bytes of JSON as {name}, at most {limit} fit", "keep lists as arrays")


def _header_fields(header: Header) -> dict[str, Any]:
    fields = {name: getattr(header, name) for name in _HEADER}
    parents = [{"id": str(parent.id), "content_sha256": parent.content_sha256} for parent in header.parents]
    return fields | {"id": str(header.id), "parents": parents}


def _header(fields: Mapping[str, Any], expected: ArtifactId) -> Header:
    """Check a header; raise ValueError if it is invalid, and StoreError if it is not for this artifact or version."""
    if {name: type(value) for name, value in fields.items()} != _HEADER:
        raise ValueError("its header is not that of an artifact")
    kind_spec(fields["kind"], str(expected))
    if fields["schema_version"] < 1:
        raise StoreError(f"{expected} has schema {fields['schema_version']}, the first was 1", "it was not made by skill")
    if fields["id"] != str(expected) or fields["kind"] != expected.stage:
        raise StoreError(
            f"the file of {expected} holds {fields['kind']} {fields['id']!r}",
            "it was copied or renamed by hand: move it back",
        )
    if not _SHA256.fullmatch(fields["content_sha256"]):
        raise ValueError("its content hash is not a SHA-256")
    if fields["inputs_sha256"] and not _SHA256.fullmatch(fields["inputs_sha256"]):
        raise ValueError("its hash of inputs is not a SHA-256")
    if not 0 <= fields["seed"] < 2**63:
        raise ValueError("its seed is not between 0 and 2**63 - 1")
    if not _RECIPE_NAME.fullmatch(fields["recipe_name"]):
        raise ValueError("its recipe name is not one of at most 64 letters, digits and . _ -")
    _check_time(fields["created_utc"])
    parents = tuple(map(_parent, fields["parents"][: MAX_PARENTS + 1]))
    if len(parents) > MAX_PARENTS:
        raise ValueError(f"it has {len(fields['parents'])} parents, at most {MAX_PARENTS} are read")
    if expected in [parent.id for parent in parents]:
        raise ValueError("it says that it was made from itself")
    own = {name: fields[name] for name in _HEADER if name not in ("id", "kind", "parents")}
    return Header(id=expected, parents=parents, **own)


def _check_time(text: str) -> None:
    if not _TIME.fullmatch(text):
        raise ValueError("its creation time is not a UTC time with microseconds between 2000 and 2099")
    datetime.fromisoformat(text)  # refuses days such as 30 February


def _fits(form: re.Pattern[str], value: str | int) -> bool:
    return isinstance(value, str) and form.fullmatch(value) is not None


def _parent(entry: Any) -> Parent:
    if not isinstance(entry, dict) or {name: type(value) for name, value in entry.items()} != {
        "id": str,
        "content_sha256": str,
    }:
        raise ValueError("its parents are not given by id and content hash")
    if not _SHA256.fullmatch(entry["content_sha256"]):
        raise ValueError("the content hash of a parent is not a SHA-256")
    return Parent(ArtifactId.parse(entry["id"]), entry["content_sha256"])


def _artifact(header: Header, contents: Contents) -> Artifact:
    """Build an artifact; raise ValueError if the parts of the file contradict each other."""
    attributes = contents.attributes
    fields = _header_fields(header)
    texts = {name: parse_record(contents, name) for name in _TEXTS}
    different = [name for name in _SHARED if attributes.get(name) != fields[name]]
    different += ["parents"] if texts["parents"] != fields["parents"] else []
    different += ["recipe"] if attributes.get("recipe_sha256") != sha256(texts["recipe"]) else []
    different += sorted(_ATTRIBUTES ^ attributes.keys())
    if different:
        raise ValueError(f"its header and what lies inside disagree about {', '.join(different)}")
    odd = [name for name, form in _ATTRIBUTE_FORMS.items() if not _fits(form, attributes[name])]
    odd += [] if attributes["git_dirty"] in (0, 1) else ["git_dirty"]
    if odd:
        raise ValueError(f"its {', '.join(odd)} is not what the store writes")
    wrong = [name for name in ("recipe", "results", "measured", "packages") if not isinstance(texts[name], dict)]
    wrong += [] if isinstance(texts["command"], str) else ["command"]
    wrong += ["packages"] if not wrong and not all(isinstance(each, str) for each in texts["packages"].values()) else []
    if wrong:
        raise ValueError(f"{', '.join(wrong)} has the wrong type: expected a text for the command, JSON objects for the others")
    if str(texts["recipe"].get("name", "")) != header.recipe_name:
        raise ValueError(f"its header names the recipe {header.recipe_name!r}, inside it is another")
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
