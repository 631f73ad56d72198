"""Artifacts with their ancestors in one file: a plain tar of a manifest and the files as they lie in the store.

Reading takes nothing on trust. Only regular files are known, under names that are ids, in the order and with the sizes and
hashes of the manifest; nothing is unpacked by a library that follows links, and nothing is compressed.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from skillcli.errors import StoreError
from skillcli.store import atomic, codec
from skillcli.store.artifact import Artifact, content_hash
from skillcli.store.atomic import storage_errors
from skillcli.store.block import MAGIC
from skillcli.store.container import open_regular, peek, reading
from skillcli.store.ids import ArtifactId
from skillcli.store.store import Store
from skillcli.store.text import canonical, parse

MANIFEST = "manifest.json"
FORMAT = {"format": "skill-export", "version": 1}
MAX_MANIFEST_BYTES = 1 << 20
MAX_ARTIFACTS = 1000

_BLOCK = 512  # of a tar
_HINT = "ask for a new export"


@dataclass(frozen=True)
class Imported:
    """What became of one artifact of an export."""

    id: ArtifactId  # under which it is in the store now
    exported: ArtifactId  # under which it was exported
    new: bool  # False: the same content was already here


def export(store: Store, artifact_id: ArtifactId, path: Path) -> list[ArtifactId]:
    """Write an artifact and its ancestors into one new file.

    Returns:
        What is in it, ancestors first.

    Raises:
        StoreError: one of them is gone or damaged, or the disk refuses.
    """
    ids = _ancestors_first(store, artifact_id)
    for one in ids:
        if problems := store.verify(one):
            raise StoreError(f"cannot export {artifact_id}: {problems[0]}", f"`skill verify {one} --lineage` shows it all")
    with storage_errors(f"read {store.root}"):
        files = {one: store.path(one).read_bytes() for one in ids}
    entries = [
        {
            "id": str(one),
            "content_sha256": store.header(one).content_sha256,
            "bytes": len(data),
            "sha256": hashlib.sha256(data).hexdigest(),
        }
        for one, data in files.items()
    ]
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        _add(tar, MANIFEST, canonical({**FORMAT, "artifacts": entries}).encode())
        for one, data in files.items():
            _add(tar, f"{one}.h5", data)
    with storage_errors(f"write {path}"):
        atomic.make_folder(path.absolute().parent)
    atomic.write_atomically(path.absolute(), packed.getbuffer(), Path.stat)
    return ids


def import_file(store: Store, path: Path, check: Callable[[Artifact], None] = lambda _: None) -> list[Imported]:
    """Take the artifacts of an export, or a single artifact's file, into a store.

    All are checked before the first gets its name. One whose id is taken by another content gets the next free version,
    and those made from it say so.

    Args:
        store: where to.
        path: the file.
        check: sees every artifact too, and may raise a StoreError to refuse them all.

    Raises:
        StoreError: the file is damaged, hostile or made by a newer skill, or the store refuses.
    """
    with _unpacked(store, path, check) as artifacts:
        renamed: dict[ArtifactId, ArtifactId] = {}
        imported = []
        for artifact in artifacts:
            parents = tuple(replace(parent, id=renamed.get(parent.id, parent.id)) for parent in artifact.parents)
            target, new = _place(store, artifact)
            if new:
                store.put(replace(artifact, id=target, parents=parents))
            renamed[artifact.id] = target
            imported.append(Imported(target, artifact.id, new))
    return imported


def _ancestors_first(store: Store, artifact_id: ArtifactId) -> list[ArtifactId]:
    ordered: dict[ArtifactId, None] = {}

    def visit(one: ArtifactId) -> None:
        for parent in store.header(one).parents:
            if parent.id not in ordered:
                visit(parent.id)
        ordered[one] = None

    visit(artifact_id)
    return list(ordered)


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size, info.mode = len(data), 0o644  # no times, users or places: equal content, equal file
    tar.addfile(info, io.BytesIO(data))


def _place(store: Store, artifact: Artifact) -> tuple[ArtifactId, bool]:
    """The id under which an artifact is, or may become part of the store, and whether it is new there."""
    series = [one for one in store.ids() if one.series == artifact.id.series]
    for one in series:
        if _content(store, one) == artifact.content_sha256:
            return one, False
    path = store.path(artifact.id)
    with storage_errors(f"write in {store.root}"):
        atomic.make_folder(path.parent)
        if atomic.keep_claim(path.parent, path.stem) and artifact.id not in series:
            return artifact.id, True
    version = atomic.claim_version(store.root / artifact.id.name, artifact.kind)
    return replace(artifact.id, version=version), True


def _content(store: Store, artifact_id: ArtifactId) -> str:
    try:
        return store.header(artifact_id).content_sha256
    except StoreError:
        return ""


@contextmanager
def _unpacked(store: Store, path: Path, check: Callable[[Artifact], None]) -> Iterator[Iterator[Artifact]]:
    """All artifacts of a file, each checked, ancestors first; one at a time in memory."""
    with ExitStack() as stack:
        if _is_single(path):
            with reading(path):
                single = ArtifactId.parse(str(peek(path)["id"]))
            places = [(single, path)]
            check(_checked(single, path))
        else:
            places = list(_extracted(store, path, check, stack))
        yield (codec.read_artifact(place, one, older=True) for one, place in places)


def _is_single(path: Path) -> bool:
    with reading(path), open_regular(path) as file:
        return file.read(len(MAGIC)) == MAGIC


def _extracted(
    store: Store, path: Path, check: Callable[[Artifact], None], stack: ExitStack
) -> Iterator[tuple[ArtifactId, Path]]:
    """Copy each artifact of an export into the store's folder, under a temporary name until `stack` is closed, and check it."""
    known: dict[ArtifactId, str] = {}
    with reading(path), open_regular(path) as file:
        members = _members(file)
        name, size = next(members, ("", 0))
        if name != MANIFEST or size > MAX_MANIFEST_BYTES:
            raise ValueError("it does not begin with the manifest of an export")
        entries = _entries(parse(file.read(size)))
        with storage_errors(f"write in {store.root}"):
            atomic.make_folder(store.root)
        for entry in entries:
            one = ArtifactId.parse(entry["id"])
            if next(members, None) != (f"{one}.h5", entry["bytes"]):
                raise ValueError(f"{one} is not where its manifest says")
            data = file.read(entry["bytes"])
            if hashlib.sha256(data).hexdigest() != entry["sha256"]:
                raise ValueError(f"the bytes of {one} have changed")
            temporary = atomic.temporary_beside(store.root / "import.h5")
            stack.callback(temporary.unlink, missing_ok=True)
            with storage_errors(f"write in {store.root}"):
                temporary.write_bytes(data)
            artifact = _checked(one, temporary)
            check(artifact)
            _check_parents(artifact, entry, known)
            known[one] = artifact.content_sha256
            yield one, temporary
        if next(members, None):
            raise ValueError("it holds more than its manifest says")


def _checked(artifact_id: ArtifactId, path: Path) -> Artifact:
    artifact = codec.read_artifact(path, artifact_id, older=True)
    if content_hash(artifact) != artifact.content_sha256:
        raise StoreError(f"the content hash of {artifact_id} is not that of its content", _HINT)
    return artifact


def _check_parents(artifact: Artifact, entry: dict[str, Any], known: dict[ArtifactId, str]) -> None:
    if artifact.content_sha256 != entry["content_sha256"]:
        raise ValueError(f"{artifact.id} is not what its manifest says")
    lacking = [parent for parent in artifact.parents if known.get(parent.id) != parent.content_sha256]
    if artifact.id in known or lacking:
        raise ValueError(f"{artifact.id} stands twice, or before what it was made from")


def _members(file: BinaryIO) -> Iterator[tuple[str, int]]:
    """Name and size of each member of a tar, while `file` stands at its first byte.

    Raises:
        ValueError: it is not a tar of regular files with plain headers.
    """
    position, end = 0, file.seek(0, io.SEEK_END)
    while True:
        file.seek(position)
        header = file.read(_BLOCK)
        if not header.strip(b"\0"):
            return
        try:
            info = tarfile.TarInfo.frombuf(header, "ascii", "strict")
        except tarfile.TarError as error:
            raise ValueError(f"it is not an export: {error}") from error
        position += _BLOCK
        if info.type != tarfile.REGTYPE or not 0 <= info.size <= end - position:
            raise ValueError(f"{info.name!r} is not a whole regular file")
        yield info.name, info.size
        position += -(-info.size // _BLOCK) * _BLOCK


def _entries(manifest: Any) -> list[dict[str, Any]]:
    """What a manifest lists.

    Raises:
        ValueError: it is not a manifest.
        StoreError: it is of a newer format.
    """
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT["format"]:
        raise ValueError("it is not an export of skill")
    if manifest.get("version") != FORMAT["version"]:
        raise StoreError(f"the export has format {manifest.get('version')!r}, this skill reads 1", "install a newer skill")
    entries = manifest.get("artifacts")
    shape = {"id": str, "content_sha256": str, "bytes": int, "sha256": str}
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_ARTIFACTS:
        raise ValueError(f"it lists no artifacts, or more than {MAX_ARTIFACTS}")
    if any(not isinstance(entry, dict) or {k: type(v) for k, v in entry.items()} != shape for entry in entries):
        raise ValueError("its manifest is not in the form of one")
    return entries
