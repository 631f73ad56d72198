"""Take artifacts from elsewhere into a store: under their own ids if possible, never over what is there."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.store import atomic, codec
from skillcli.store.artifact import Artifact, content_hash
from skillcli.store.ids import ArtifactId
from skillcli.store.store import Store

LAST_IMPORTED = 1_000_000
"""Higher version numbers are not taken from a file: the next training needs a higher one."""


@dataclass(frozen=True)
class Imported:
    """The result of importing one artifact."""

    id: ArtifactId  # its id in this store
    exported: ArtifactId  # its id in the export
    new: bool  # False: the same content was already here
    replaced: bool = False  # the copy here was damaged and was replaced


class _Here(Exception):
    """The content appeared in the store while it was being written."""

    def __init__(self, found: ArtifactId) -> None:
        super().__init__(found)
        self.id = found


def keep(store: Store, artifact: Artifact, replace_damaged: bool = False) -> Imported:
    """Give an artifact that was checked its place in the store, unless it has one.

    It keeps its id if that was never given to other content here, and its number is at most `LAST_IMPORTED`; otherwise it
    gets the next free version.

    Raises:
        StoreError: the copy in the store is damaged, a parent is missing, or the store refuses.
    """
    found = same(store, artifact.id, artifact.content_sha256, or_illegible=True)
    if found is None:
        return _keep_new(store, artifact)
    if not (problem := _damage(store, found, artifact.content_sha256)):
        return Imported(found, artifact.id, new=False)
    if not replace_damaged:
        raise StoreError(f"{found} is here, but damaged: {problem}", "`skill import --replace` puts the whole one in its place")
    store.put(replace(artifact, id=found), artifact.parents, replace=True)
    return Imported(found, artifact.id, new=False, replaced=True)


def _keep_new(store: Store, artifact: Artifact) -> Imported:
    def admit() -> None:
        if found := same(store, artifact.id, artifact.content_sha256):
            raise _Here(found)

    target = _claim(store, artifact.id, artifact.content_sha256)
    try:
        store.put(replace(artifact, id=target), artifact.parents, admit=admit)
    except _Here as here:
        return Imported(here.id, artifact.id, new=False)
    return Imported(target, artifact.id, new=True)


def _claim(store: Store, artifact_id: ArtifactId, content_sha256: str) -> ArtifactId:
    """Claim this id for this content if no other had it here, else the next version.

    The claim names the content: whoever was killed before the artifact had its name gets the same id again.
    """
    path = store.path(artifact_id)
    if artifact_id.version <= LAST_IMPORTED:
        atomic.make_folder(path.parent)
        if atomic.claim_for(path.parent, path.stem, content_sha256) and not os.path.lexists(path):
            return artifact_id
    return replace(artifact_id, version=atomic.claim_version(path.parent, artifact_id.stage))


def same(store: Store, artifact_id: ArtifactId, content_sha256: str, *, or_illegible: bool = False) -> ArtifactId | None:
    """Find the artifact of a series whose header has this content hash, under the given id if possible.

    With `or_illegible`, also return the id itself if its header cannot be read.
    """
    series = sorted(store.versions(artifact_id), key=lambda one: one != artifact_id)
    contents = {one: _content(store, one) for one in series}
    illegible = [artifact_id] if or_illegible and contents.get(artifact_id) == "" else []
    found = [*(one for one in series if contents[one] == content_sha256), *illegible]
    return found[0] if found else None


def _content(store: Store, artifact_id: ArtifactId) -> str | None:
    """Return the content hash in an artifact's header; "" if it is damaged, None if it is missing or not readable.

    Raises:
        StoreError: the disk fails.
    """
    try:
        return store.header(artifact_id).content_sha256
    except StoreError as error:
        if atomic.is_disk_failure(error):
            raise
        return None if isinstance(error, UnknownArtifact) or isinstance(error.__cause__, OSError) else ""


def _damage(store: Store, artifact_id: ArtifactId, content_sha256: str) -> str:
    """Describe what is wrong with a stored artifact that should have this content; "" if nothing.

    Raises:
        StoreError: the disk fails.
    """
    try:
        found = check_file(artifact_id, store.path(artifact_id)).content_sha256
    except StoreError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno:
            raise
        return error.message
    return "" if found == content_sha256 else f"its content is {found[:12]}"


def check_file(artifact_id: ArtifactId, path: Path, hint: str = "") -> Artifact:
    """Read an artifact of any schema, and compare its content hash with its content.

    Raises:
        StoreError: it is damaged, hostile, of a newer schema, or another artifact.
    """
    artifact = codec.read_artifact(path, artifact_id, older=True)
    if content_hash(artifact) != artifact.content_sha256:
        raise StoreError(f"the content hash of {artifact_id} is not that of its content", hint)
    return artifact
