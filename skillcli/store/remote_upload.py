"""Send artifacts with their ancestors to a shared store.

It may end at any moment and run in many places at once: files are named by their hash, an id is claimed for one content,
and an artifact becomes visible last, after all that it was made from.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from skillcli.errors import StoreError
from skillcli.progress import OnProgress, Progress, silent
from skillcli.store import block, codec
from skillcli.store.archive import ancestors_first
from skillcli.store.artifact import Header
from skillcli.store.atomic import storage_errors
from skillcli.store.ids import LAST_VERSION, ArtifactId
from skillcli.store.quarantine import MAX_FILE_BYTES
from skillcli.store.remote_files import Files
from skillcli.store.remote_index import Catalog, Entry, claim
from skillcli.store.store import Store


@dataclass
class Transfer:
    """What became of the artifacts, ancestors first; ids are those of the side that gave them."""

    transferred: list[ArtifactId] = field(default_factory=list)
    skipped: list[ArtifactId] = field(default_factory=list)  # the other side had them
    renamed: dict[ArtifactId, ArtifactId] = field(default_factory=dict)  # to their ids on the other side, if they differ
    bytes: int = 0

    def add(self, one: ArtifactId, there: ArtifactId, size: int | None) -> None:
        """Note one artifact; `size` None: the other side had it."""
        (self.skipped if size is None else self.transferred).append(one)
        self.bytes += size or 0
        if there != one:
            self.renamed[one] = there

    def join(self, other: Transfer) -> None:
        """Add what a later transfer did; what was told already is not told again."""
        before = {*self.transferred, *self.skipped}
        self.transferred += [one for one in other.transferred if one not in before]
        self.skipped += [one for one in other.skipped if one not in before]
        self.renamed |= other.renamed
        self.bytes += other.bytes


def upload(store: Store, files: Files, wanted: Sequence[ArtifactId], on_progress: OnProgress = silent) -> Transfer:
    """Send artifacts and their ancestors, and read back what was sent.

    An id that other content has there is not taken from it: the artifact gets the next free version there, as at an import.

    Raises:
        StoreError: one of them is missing or damaged, the shared store refuses, or gives back something else. What was sent
            before stays, whole.
    """
    catalog = Catalog.of(files)
    todo = list(dict.fromkeys(one for last in wanted for one in ancestors_first(store, last)))
    done = Transfer()
    for number, one in enumerate(todo):
        on_progress(Progress("upload", number, len(todo), "artifacts", note=str(one)))
        header = store.header(one)
        entry = catalog.find(one, header.content_sha256)
        if entry and entry.id != one and not catalog.is_other(one, header.content_sha256):
            entry = None  # its own id is free
        if entry and catalog.has_file(entry):
            done.add(one, entry.id, None)
        else:
            sent = _send(store, files, catalog, header, entry.id if entry else one, done.renamed)
            done.add(one, sent.id, sent.bytes)
    return done


def _send(
    store: Store,
    files: Files,
    catalog: Catalog,
    header: Header,
    preferred: ArtifactId,
    renamed: Mapping[ArtifactId, ArtifactId],
) -> Entry:
    if problems := store.verify(header.id):
        raise StoreError(f"cannot upload {header.id}: {problems[0]}", f"`skill verify {header.id} --lineage` shows it all")
    target = _claimed(files, catalog, preferred, header.content_sha256)
    data = _bytes(store, header, target, renamed)
    entry = Entry.of(header, target, hashlib.sha256(data).hexdigest(), len(data))
    if not (catalog.has_object(entry.object) and files.read(entry.object, len(data)) == data):
        files.write(entry.object, data)
        if files.read(entry.object, len(data)) != data:
            raise StoreError(
                f"{header.id} read back from {files.address} differs from what was sent", "check the disk or network there"
            )
    files.write(entry.name, b"")
    return entry


def _claimed(files: Files, catalog: Catalog, preferred: ArtifactId, content: str) -> ArtifactId:
    """Claim an id for this content, or the next free version; a claim of a killed upload is found again."""
    for target in _candidates(catalog, preferred):
        if catalog.is_other(target, content):
            continue
        if files.create(claim(target), content.encode()) or files.read(claim(target), len(content)) == content.encode():
            return target
    raise StoreError(f"{preferred.series} has had its last version at {files.address}", "upload it to another address")


def _candidates(catalog: Catalog, preferred: ArtifactId) -> Iterator[ArtifactId]:
    yield preferred
    for version in range(max(catalog.last_version(preferred), preferred.version) + 1, LAST_VERSION + 1):
        yield replace(preferred, version=version)


def _bytes(store: Store, header: Header, target: ArtifactId, renamed: Mapping[ArtifactId, ArtifactId]) -> bytes:
    """Return the artifact's file; made anew if it or a parent has another id there."""
    path = store.path(header.id)
    if target != header.id or any(parent.id in renamed for parent in header.parents):
        artifact = codec.read_artifact(path, header.id, older=True)
        parents = tuple(replace(parent, id=renamed.get(parent.id, parent.id)) for parent in artifact.parents)
        data = bytes(codec.encode(replace(artifact, id=target, parents=parents)))
    else:
        with storage_errors(f"read {path}"):
            data = path.read_bytes()
        try:
            block.check_digest(io.BytesIO(data))
        except ValueError as error:
            raise StoreError(f"cannot upload {header.id}: {error}", "it changed while it was read: run it again") from error
    if len(data) > MAX_FILE_BYTES:
        raise StoreError(f"cannot upload {header.id}: nobody could download more than {MAX_FILE_BYTES} bytes", "record less")
    return data
