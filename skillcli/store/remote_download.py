"""Fetch artifacts with their ancestors from a shared store, which is believed in nothing.

Files are compared with the hash in their name and parsed in a separate process, as at an import, before they get a name.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path

from skillcli.errors import StoreError
from skillcli.kinds import KINDS
from skillcli.progress import OnProgress, Progress, silent
from skillcli.store import atomic, codec
from skillcli.store.artifact import Artifact, Parent
from skillcli.store.atomic import storage_errors
from skillcli.store.ids import ArtifactId
from skillcli.store.quarantine import MAX_FILE_BYTES
from skillcli.store.receive import check_file, keep, same
from skillcli.store.remote_files import Files
from skillcli.store.remote_index import Catalog, Entry
from skillcli.store.remote_upload import Transfer
from skillcli.store.store import Store

Key = tuple[ArtifactId, str]  # an id there, and a content hash


def download(
    store: Store,
    files: Files,
    wanted: Sequence[str],
    check: Callable[[Artifact], None] = lambda _: None,
    on_progress: OnProgress = silent,
) -> Transfer:
    """Fetch artifacts and those of their ancestors that are not here.

    Each is checked with all its ancestors before the first of them gets its name. An id that other content has here is not
    taken from it: the artifact gets the next free version, as at an import.

    Args:
        store: where to put them.
        files: the shared store.
        wanted: ids there, `NAME/STAGE` or unique prefixes.
        check: called with every artifact; may raise a StoreError to refuse it.
        on_progress: called before each.

    Raises:
        StoreError: an artifact is missing, damaged, hostile or not what its name says, or the store or the network refuses.
            What was fetched before stays.
    """
    catalog = Catalog.of(files)
    entries = list(dict.fromkeys(catalog.pick(text) for text in wanted))
    done = Transfer()
    with storage_errors(f"write in {store.root}"):
        atomic.make_folder(store.root)
        with suppress(OSError):
            atomic.sweep(store.root)
        for number, entry in enumerate(entries):
            on_progress(Progress("download", number, len(entries), "artifacts", note=str(entry.id)))
            _Fetch(store, files, catalog, check, done).take(entry)
    return done


class _Fetch:
    """One artifact with its ancestors: all are fetched and checked, then all are kept."""

    def __init__(self, store: Store, files: Files, catalog: Catalog, check: Callable[[Artifact], None], done: Transfer) -> None:
        self._store, self._files, self._catalog, self._check, self._done = store, files, catalog, check, done
        self._staged: dict[Key, Path] = {}  # ancestors first
        self._here: dict[Key, ArtifactId] = {}

    def take(self, entry: Entry) -> None:
        """Fetch what is not here, and keep it."""
        key = (entry.id, entry.content_sha256)
        with ExitStack() as stack:
            if not self._is_here(key):
                self._fetch(entry, stack, depth=1)
            for (one, content), path in self._staged.items():
                artifact = codec.read_artifact(path, one, older=True)
                parents = tuple(self._parent(parent) for parent in artifact.parents)
                kept = keep(self._store, replace(artifact, parents=parents))
                self._here[one, content] = kept.id
                self._note(one, kept.id, artifact.bytes if kept.new else None)

    def _is_here(self, key: Key) -> bool:
        if key in self._here:
            return True
        found = same(self._store, *key)
        if found is None:
            return False
        if problems := self._store.verify(found):
            raise StoreError(f"{found} is here, but damaged: {problems[0]}", "move its file away, then download it again")
        self._here[key] = found
        self._note(key[0], found, None)
        return True

    def _note(self, one: ArtifactId, here: ArtifactId, size: int | None) -> None:
        if one not in self._done.transferred and one not in self._done.skipped:
            self._done.add(one, here, size)

    def _fetch(self, entry: Entry, stack: ExitStack, depth: int) -> None:
        if depth > len(KINDS):
            raise StoreError(f"{entry.id} is made from too long a line of artifacts", "it was not made by skill")
        temporary = atomic.temporary_beside(self._store.root / "download.h5")
        stack.callback(temporary.unlink, missing_ok=True)
        temporary.write_bytes(self._bytes(entry))
        artifact = check_file(entry.id, temporary, self._hint(entry))
        if artifact.content_sha256 != entry.content_sha256:
            raise StoreError(
                f"{entry.id} at {self._files.address} has the content {artifact.content_sha256[:12]}, its index says "
                f"{entry.content_sha256[:12]}",
                self._hint(entry),
            )
        self._check(artifact)
        for parent in artifact.parents:
            key = (parent.id, parent.content_sha256)
            if key not in self._staged and not self._is_here(key):
                self._fetch(self._entry(artifact, parent), stack, depth + 1)
        self._staged[entry.id, entry.content_sha256] = temporary

    def _bytes(self, entry: Entry) -> bytes:
        """Return the file of an artifact, which is the one that its name says."""
        if entry.bytes > MAX_FILE_BYTES:
            raise StoreError(
                f"{entry.id} at {self._files.address} has {entry.bytes} bytes, at most {MAX_FILE_BYTES} are read from elsewhere"
            )
        data = self._files.read(entry.object, entry.bytes)
        if data is None:
            raise StoreError(f"the file of {entry.id} is missing at {self._files.address}", self._hint(entry))
        found = hashlib.sha256(data).hexdigest()
        if len(data) != entry.bytes or found != entry.sha256:
            problem = (
                f"its bytes have changed: {found[:12]}, expected {entry.sha256[:12]}"
                if len(data) == entry.bytes
                else f"it has {'more' if len(data) > entry.bytes else 'fewer'} than the {entry.bytes} bytes that were sent"
            )
            raise StoreError(f"the file of {entry.id} at {self._files.address} is damaged: {problem}", self._hint(entry))
        return data

    def _entry(self, child: Artifact, parent: Parent) -> Entry:
        entry = self._catalog.find(parent.id, parent.content_sha256)
        if entry is None or entry.id != parent.id:
            raise StoreError(
                f"{child.id} was made from {parent.id}, which is neither at {self._files.address} nor, with that content, here",
                f"upload {child.id} again from a store that holds both",
            )
        return entry

    def _parent(self, parent: Parent) -> Parent:
        return replace(parent, id=self._here[parent.id, parent.content_sha256])

    def _hint(self, entry: Entry) -> str:
        return f"remove {entry.object} there, then `skill upload {self._files.address} {entry.id}` where it is whole"
