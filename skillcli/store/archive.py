"""Artifacts with their ancestors in one file: a plain tar of a manifest and the files of the store.

The reader trusts nothing. It accepts only regular files whose names are ids, in the order and with the sizes and hashes of
the manifest. No library that follows links unpacks them, and nothing is compressed.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from skillcli.errors import StoreError
from skillcli.kinds import KINDS
from skillcli.paths import open_regular
from skillcli.store import atomic, codec
from skillcli.store.artifact import Artifact, Parent
from skillcli.store.atomic import storage_errors
from skillcli.store.block import MAGIC
from skillcli.store.canonical_json import canonical, parse
from skillcli.store.container import peek, reading
from skillcli.store.ids import ArtifactId
from skillcli.store.quarantine import MAX_FILE_BYTES
from skillcli.store.receive import Imported, check_file, keep, same
from skillcli.store.store import Store

MANIFEST = "manifest.json"
FORMAT = {"format": "skill-export", "version": 1}
MAX_MANIFEST_BYTES = 1 << 20
MAX_ARTIFACTS = len({kind for spec in KINDS.values() if spec.made_from for kind in (spec.name, *spec.made_from)})
"""An artifact and its ancestors: each was made from one of an earlier kind."""

_BLOCK = 512  # block size of a tar
_LONGEST_END = 1 << 14  # zeros after the last member
_PIECE = 1 << 20  # bytes copied at a time
_NEITHER = {
    b"\x1f\x8b": "packed with gzip",
    b"BZh": "packed with bzip2",
    b"\xfd7zXZ": "packed with xz",
    b"\x28\xb5\x2f\xfd": "packed with zstd",
    b"PK\3\4": "a zip file",
    b"\x89HDF": "another HDF5 file",
}
_HINT = "give what `skill export` wrote, or the .h5 file of one artifact; if it is damaged, ask for it anew"


def export(store: Store, artifact_id: ArtifactId, path: Path) -> list[ArtifactId]:
    """Write an artifact and its ancestors into one new file.

    Returns:
        The exported ids, ancestors first.

    Raises:
        StoreError: one of them is missing or damaged, or the disk refuses.
    """
    ids = ancestors_first(store, artifact_id)
    for one in ids:
        if problems := store.verify(one):
            raise StoreError(f"cannot export {artifact_id}: {problems[0]}", f"`skill verify {one} --lineage` shows it all")
        if store.header(one).bytes > MAX_FILE_BYTES:
            raise StoreError(
                f"cannot export {one}: nobody could import more than {MAX_FILE_BYTES} bytes", "record fewer episodes"
            )
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
    with suppress(OSError):
        atomic.sweep(path.absolute().parent)
    atomic.write_atomically(path.absolute(), packed.getbuffer(), Path.stat)
    return ids


def import_file(
    store: Store, path: Path, check: Callable[[Artifact], None] = lambda _: None, *, replace_damaged: bool = False
) -> list[Imported]:
    """Import the artifacts of an export, or a single artifact's file, into a store.

    All artifacts are checked before the first gets its name. If an id is taken by other content, or its number is beyond
    `LAST_IMPORTED`, the artifact gets the next free version, and its children refer to that. Parents must be in the file or
    in the store.

    Args:
        store: where to import to.
        path: the file.
        check: called with every artifact; may raise a StoreError to refuse them all.
        replace_damaged: whether a damaged copy in the store may be replaced by the intact one from the file.

    Raises:
        StoreError: the file is damaged, hostile or made by a newer skill, a parent is missing, the copy in the store is
            damaged, or the store refuses.
    """
    renamed: dict[ArtifactId, ArtifactId] = {}
    imported = []
    with storage_errors(f"write in {store.root}"), _unpacked(store, path, check) as artifacts:
        for artifact in artifacts:
            parents = tuple(_parent(store, artifact, parent, renamed) for parent in artifact.parents)
            imported.append(keep(store, replace(artifact, parents=parents), replace_damaged))
            renamed[artifact.id] = imported[-1].id
    return imported


def ancestors_first(store: Store, artifact_id: ArtifactId) -> list[ArtifactId]:
    """Return an artifact and all that it was made from, ancestors first.

    Raises:
        StoreError: one is missing or damaged, or was made from itself.
    """
    ordered: dict[ArtifactId, None] = {}
    entered: set[ArtifactId] = set()
    pending = [(artifact_id, False)]
    while pending:
        one, visited = pending.pop()
        if visited:
            ordered[one] = None
        elif one not in ordered:
            if one in entered:
                raise StoreError(f"cannot send {artifact_id}: {one} was made from itself", f"`skill verify {one} --lineage`")
            entered.add(one)
            pending.append((one, True))
            pending += [(parent.id, False) for parent in reversed(store.header(one).parents)]
    return list(ordered)


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size, info.mode = len(data), 0o644  # no times, users or paths: equal content gives an equal file
    tar.addfile(info, io.BytesIO(data))


def _parent(store: Store, artifact: Artifact, parent: Parent, renamed: Mapping[ArtifactId, ArtifactId]) -> Parent:
    """Return a parent of an artifact under its id in the store."""
    found = renamed.get(parent.id) or same(store, parent.id, parent.content_sha256)
    if found is None:
        problem = (
            f"{artifact.id} was made from {parent.id}, which is neither in the file nor, with that content, in {store.root}"
        )
        raise StoreError(problem, f"import an export that holds both: `skill export {artifact.id}` where it comes from")
    return replace(parent, id=found)


@contextmanager
def _unpacked(store: Store, path: Path, check: Callable[[Artifact], None]) -> Iterator[Iterator[Artifact]]:
    """Yield all artifacts of a file, each checked, ancestors first; one at a time in memory."""
    with ExitStack() as stack:
        if _is_single(path):
            with reading(path, _HINT):
                single = ArtifactId.parse(str(peek(path)["id"]))
            places = [(single, path)]
            check(check_file(single, path, _HINT))
        else:
            places = list(_extracted(store, path, check, stack))
        yield (codec.read_artifact(place, one, older=True) for one, place in places)


def _is_single(path: Path) -> bool:
    """Return whether the file is a single artifact.

    Raises:
        StoreError: it is neither that nor an export.
    """
    with reading(path, _HINT), open_regular(path) as file:
        start = file.read(_BLOCK)
        for beginning, what in _NEITHER.items():
            if start.startswith(beginning):
                raise ValueError(f"it is {what}, neither an export of skill nor an artifact's file")
        return start.startswith(MAGIC)


def _extracted(
    store: Store, path: Path, check: Callable[[Artifact], None], stack: ExitStack
) -> Iterator[tuple[ArtifactId, Path]]:
    """Copy each artifact of an export into the store under a temporary name, until `stack` closes, and check it."""
    known: dict[ArtifactId, str] = {}
    needed: set[ArtifactId] = set()
    with reading(path, _HINT), open_regular(path) as file:
        members = _members(file)
        name, size = next(members, ("", 0))
        if name != MANIFEST or size > MAX_MANIFEST_BYTES:
            raise ValueError("it is a tar, but not one that `skill export` wrote")
        entries = _entries(parse(file.read(size)))
        with storage_errors(f"write in {store.root}"):
            atomic.make_folder(store.root)
        for entry in entries:
            one = ArtifactId.parse(entry["id"])
            if next(members, None) != (f"{one}.h5", entry["bytes"]):
                raise ValueError(f"{one} is not where its manifest says")
            temporary = atomic.temporary_beside(store.root / "import.h5")
            stack.callback(temporary.unlink, missing_ok=True)
            if _copied(file, entry["bytes"], temporary) != entry["sha256"]:
                raise ValueError(f"the bytes of {one} have changed")
            artifact = check_file(one, temporary, _HINT)
            check(artifact)
            _check_parents(artifact, entry, known)
            known[one] = artifact.content_sha256
            needed.update(parent.id for parent in artifact.parents)
            yield one, temporary
        if spare := known.keys() - needed - {one}:
            raise ValueError(f"{min(spare)} is in it, and {one} was not made from it")
        if next(members, None):
            raise ValueError("it holds more than its manifest says")


def _copied(file: BinaryIO, length: int, target: Path) -> str:
    """Copy bytes of an export into a new file, in pieces; return their SHA-256."""
    if length > MAX_FILE_BYTES:
        raise ValueError(f"it holds a file of {length} bytes, at most {MAX_FILE_BYTES} are read from elsewhere")
    sha = hashlib.sha256()
    with storage_errors(f"write in {target.parent}"), target.open("xb") as copy:
        while length > 0 and (piece := file.read(min(_PIECE, length))):
            sha.update(piece)
            copy.write(piece)
            length -= len(piece)
    return sha.hexdigest()


def _check_parents(artifact: Artifact, entry: dict[str, Any], known: dict[ArtifactId, str]) -> None:
    if artifact.content_sha256 != entry["content_sha256"]:
        raise ValueError(f"{artifact.id} is not what its manifest says")
    lacking = [parent for parent in artifact.parents if known.get(parent.id) != parent.content_sha256]
    if artifact.id in known or lacking:
        raise ValueError(f"{artifact.id} stands twice, or before what it was made from")


def _members(file: BinaryIO) -> Iterator[tuple[str, int]]:
    """Yield name and size of each member of a tar, with `file` at the member's first byte.

    Raises:
        ValueError: it is not a tar of regular files with plain headers.
    """
    position, end = 0, file.seek(0, io.SEEK_END)
    while True:
        file.seek(position)
        header = file.read(_BLOCK)
        if not header.strip(b"\0"):
            if not end:
                raise ValueError("it is empty")
            if len(header) < _BLOCK or file.read(_LONGEST_END).strip(b"\0") or file.tell() < end:
                raise ValueError("it does not end as an export does")
            return
        try:
            info = tarfile.TarInfo.frombuf(header, "ascii", "strict")
        except tarfile.TarError as error:
            raise ValueError(f"it is neither an export of skill nor an artifact's file: {error}") from error
        position += _BLOCK
        if info.type != tarfile.REGTYPE or not 0 <= info.size <= end - position:
            raise ValueError(f"it is a tar, but not one that `skill export` wrote: {info.name!r} is not a whole regular file")
        yield info.name, info.size
        position += -(-info.size // _BLOCK) * _BLOCK


def _entries(manifest: Any) -> list[dict[str, Any]]:
    """Return the entries of a manifest.

    Raises:
        ValueError: it is not a manifest.
        StoreError: its format is newer.
    """
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT["format"]:
        raise ValueError("it is not an export of skill")
    if manifest.get("version") != FORMAT["version"] or type(manifest["version"]) is not int:
        raise StoreError(f"the export has format {manifest.get('version')!r}, this skill reads 1", "install a newer skill")
    if manifest.keys() != {*FORMAT, "artifacts"}:
        raise ValueError("its manifest is not in the form of one")
    entries = manifest["artifacts"]
    shape = {"id": str, "content_sha256": str, "bytes": int, "sha256": str}
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_ARTIFACTS:
        raise ValueError(f"it lists no artifacts, or more than {MAX_ARTIFACTS}: one and its ancestors are never more")
    if any(not isinstance(entry, dict) or {k: type(v) for k, v in entry.items()} != shape for entry in entries):
        raise ValueError("its manifest is not in the form of one")
    return entries
