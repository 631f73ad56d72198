"""The artifact store: a folder of files that are written once, checked at every reading, and never overwritten."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.store import atomic, codec, pins, schema
from skillcli.store.artifact import Artifact, Draft, Header, Parent, Unreadable, content_hash
from skillcli.store.atomic import storage_errors
from skillcli.store.ids import FILE, NAME, ArtifactId, check_name
from skillcli.store.lock import locked
from skillcli.store.migrate import migrated
from skillcli.store.resolve import match, unknown

_FOLDER = re.compile(NAME, re.ASCII)
_FILE = re.compile(rf"{FILE}\.h5", re.ASCII)


class Listing(NamedTuple):
    """Everything in a store: the artifacts, newest last, and the files that are not whole."""

    headers: list[Header]
    unreadable: list[Unreadable]


@dataclass(frozen=True)
class Store:
    """The artifacts below one folder, which is created when something is first written.

    Args:
        root: the folder.
    """

    root: Path

    def write(self, draft: Draft) -> Artifact:
        """Keep a result for good under the next version of its name and kind.

        Returns:
            The artifact as it was read back from the disk.

        Raises:
            StoreError: the draft does not fit its kind, a parent is missing, or the disk refuses. Nothing is left
                under the artifact's name.
        """
        draft = codec.check_draft(draft)
        parents = tuple(Parent(one, self.header(one).content_sha256) for one in draft.parents)
        version = atomic.claim_version(self.root / check_name(draft.name), draft.kind)
        return self.put(codec.finish(draft, version, parents), parents)

    def put(self, artifact: Artifact, needed: Sequence[Parent] = ()) -> Artifact:
        """Keep a finished artifact under its own id, whose version the caller has claimed.

        Args:
            artifact: what to keep.
            needed: must still be in the store, unchanged, when the artifact gets its name.

        Raises:
            StoreError: as `write`.
        """

        def check(path: Path) -> Artifact:
            written = codec.read_artifact(path, artifact.id, older=True)
            if content_hash(written) != artifact.content_sha256:
                raise StoreError(f"{artifact.id} read back differs from what was written", "check the disk")
            return written

        naming = self._naming(artifact.id, needed)
        return atomic.write_atomically(self.path(artifact.id), codec.encode(artifact), check, naming=naming)

    @contextmanager
    def _naming(self, artifact_id: ArtifactId, needed: Sequence[Parent]) -> Iterator[None]:
        """Hold the lock while an artifact gets its name: nobody removes its parents in that moment."""
        with locked(self.root, take_over=True):
            for parent in needed:
                if problem := self._parent_problem(parent):
                    raise StoreError(f"cannot write {artifact_id}: {problem}", "it was removed meanwhile: make it anew")
            yield

    def migrate(self, artifact_id: ArtifactId, command: str) -> Artifact:
        """Make a new version of an artifact in the present schema; the original stays as it is, parents are kept.

        Raises:
            StoreError: it has the present schema or a newer one, is damaged, or the store refuses.
        """
        old = codec.read_artifact(self._existing(artifact_id), artifact_id, older=True)
        draft = codec.check_draft(migrated(old, command))
        version = atomic.claim_version(self.root / artifact_id.name, draft.kind)
        return self.put(codec.finish(draft, version, old.parents))

    def current(self, artifact_id: ArtifactId) -> ArtifactId:
        """The artifact itself or, where its schema is older, the newest one that was migrated from it.

        Raises:
            StoreError: the artifact is not there or damaged.
        """
        header = self.header(artifact_id)
        if not schema.is_older(header.kind, header.schema_version):
            return artifact_id
        series = [one for one in self.ids() if one.series == artifact_id.series and one.version > artifact_id.version]
        return next((one for one in reversed(series) if self._origin(one) == header.content_sha256), artifact_id)

    def _origin(self, artifact_id: ArtifactId) -> str:
        """Content hash of what an artifact was migrated from, "" for any other."""
        try:
            return str(self.read(artifact_id).origin.get("content_sha256", ""))
        except StoreError:
            return ""

    def check_writable(self, name: str) -> None:
        """Find out before the work whether its result could be written.

        Raises:
            StoreError: it could not, or the name is not valid.
        """
        atomic.try_writing(self.root / check_name(name))

    def path(self, artifact_id: ArtifactId) -> Path:
        """The file of an artifact."""
        return artifact_id.path(self.root)

    def checkpoint_path(self, name: str, kind: str, inputs_sha256: str) -> Path:
        """Where unfinished work with these inputs is kept."""
        return self.root / check_name(name) / f".checkpoint-{kind}-{inputs_sha256[:12]}.h5"

    def ids(self) -> list[ArtifactId]:
        """Every artifact there is, sorted, without opening any."""
        with storage_errors(f"list {self.root}"):
            return sorted(self._scan())

    def resolve(self, text: str | None, kinds: Sequence[str] = ()) -> ArtifactId:
        """The artifact that a user means.

        Args:
            text: a full id, `NAME/STAGE` for its newest version, or a unique prefix; None or "" for the newest of all.
            kinds: which kinds will do; empty for any.

        Raises:
            UnknownArtifact: nothing, or more than one, answers to the text.
            StoreError: it is not an id, or of another kind than asked for.
        """
        if text:
            return match(text, self.ids(), kinds)
        fitting = [header.id for header in self.headers() if not kinds or header.kind in kinds]
        if not fitting:
            wanted = " or ".join(kinds) or "any kind"
            hint = f"make one with `skill {kinds[0] if kinds else 'pretrain'}`"
            raise UnknownArtifact(f"there is no artifact of {wanted} in {self.root}", hint)
        return fitting[-1]

    def header(self, artifact_id: ArtifactId) -> Header:
        """What is known of an artifact without opening it.

        Raises:
            UnknownArtifact: there is none.
            StoreError: its header is damaged.
        """
        return codec.read_header(self._existing(artifact_id), artifact_id)

    def read(self, artifact_id: ArtifactId) -> Artifact:
        """The whole artifact; a damaged or hostile file is refused before its data is used.

        Raises:
            UnknownArtifact: there is none.
            StoreError: it is damaged or refused.
        """
        return codec.read_artifact(self._existing(artifact_id), artifact_id)

    def listing(self) -> Listing:
        """All headers, newest last, and what could not be read."""
        headers, unreadable = [], []
        for artifact_id in self.ids():
            try:
                headers.append(codec.read_header(self.path(artifact_id), artifact_id))
            except StoreError as error:
                unreadable.append(Unreadable(artifact_id, error.message))
        return Listing(sorted(headers, key=_age), unreadable)

    def headers(self) -> list[Header]:
        """The headers of all readable artifacts, newest last."""
        return self.listing().headers

    def find(self, kind: str, inputs_sha256: str, name: str | None = None) -> list[ArtifactId]:
        """The artifacts of this kind and the present schema that say they were made from exactly these inputs, newest first.

        Anybody can write a header: who uses one in place of work compares it with its content, see `skillcli.stages.reuse`.
        """
        if not inputs_sha256:
            return []
        version = schema.KINDS[kind].version
        wanted = (kind, version, inputs_sha256)
        same = [one for one in self.headers() if (one.kind, one.schema_version, one.inputs_sha256) == wanted]
        return [one.id for one in reversed(same) if name in (None, one.id.name)]

    def lineage(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """All ancestors, nearest first; those that are gone are named too, but theirs are not known.

        Raises:
            StoreError: the artifact itself is not there or damaged.
        """
        found: list[ArtifactId] = []
        pending = [parent.id for parent in self.header(artifact_id).parents]
        while pending:
            ancestor = pending.pop(0)
            if ancestor not in found:
                found.append(ancestor)
                pending += [parent.id for parent in self._parents(ancestor)]
        return found

    def dependents(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """The artifacts that were made directly from this one, oldest first."""
        return [header.id for header in self.headers() if artifact_id in [parent.id for parent in header.parents]]

    def verify(self, artifact_id: ArtifactId, check: Callable[[Artifact], None] = lambda _: None) -> list[str]:
        """What is wrong with an artifact, one line each; nothing when it is as it was written.

        Args:
            artifact_id: which one.
            check: sees it as well, and may raise a StoreError.

        Raises:
            UnknownArtifact: there is none.
        """
        path = self._existing(artifact_id)
        try:
            artifact = codec.read_artifact(path, artifact_id, older=True)
            check(artifact)
        except StoreError as error:
            return [error.message]
        problems = [self._parent_problem(parent) for parent in artifact.parents]
        if content_hash(artifact) != artifact.content_sha256:
            problems.append(f"the content hash of {artifact_id} is not that of its content")
        return [problem for problem in problems if problem]

    def remove(self, artifact_id: ArtifactId) -> None:
        """Delete an artifact; its version number stays taken.

        Raises:
            UnknownArtifact: there is none.
            StoreError: it is pinned, others were made from it, the store is locked, or the disk refuses.
        """
        self._existing(artifact_id)
        with locked(self.root):
            path = self._existing(artifact_id)
            if pins.is_pinned(path):
                raise StoreError(f"cannot remove {artifact_id}: it is pinned", f"`skill unpin {artifact_id}` first")
            if dependents := self.dependents(artifact_id):
                names = ", ".join(map(str, dependents[:5])) + (" and more" if len(dependents) > 5 else "")
                raise StoreError(f"cannot remove {artifact_id}: made from it: {names}", "remove those first")
            self.unlink(artifact_id)

    def pin(self, artifact_id: ArtifactId, wanted: bool = True) -> None:
        """Protect an artifact from `remove` and from being collected, or end that.

        Raises:
            UnknownArtifact: there is none.
            StoreError: the store is locked, or the disk refuses.
        """
        self._existing(artifact_id)
        with locked(self.root), storage_errors(f"write in {self.root}"):
            (pins.pin if wanted else pins.unpin)(self._existing(artifact_id))

    def pinned(self) -> set[ArtifactId]:
        """Every artifact that is pinned."""
        wanted = set(pins.all_pins(self.root))
        return {one for one in self.ids() if str(one) in wanted} if wanted else set()

    def unlink(self, artifact_id: ArtifactId) -> None:
        """Delete the file of an artifact, without a question; the caller holds the lock.

        Raises:
            StoreError: the disk refuses.
        """
        path = self.path(artifact_id)
        with storage_errors(f"remove {path}"):
            atomic.keep_claim(path.parent, path.stem)
            path.unlink()
            atomic.sync_folder(path.parent)

    def _scan(self) -> Iterator[ArtifactId]:
        if not self.root.exists():
            return
        for folder in os.scandir(self.root):
            if _FOLDER.fullmatch(folder.name) and folder.is_dir():
                for entry in os.scandir(folder.path):
                    if found := _FILE.fullmatch(entry.name):
                        yield ArtifactId(folder.name, found["stage"], int(found["version"]))

    def _existing(self, artifact_id: ArtifactId) -> Path:
        path = self.path(artifact_id)
        if not os.path.lexists(path):
            raise unknown(str(artifact_id), self.ids())
        return path

    def _parents(self, artifact_id: ArtifactId) -> tuple[Parent, ...]:
        try:
            return self.header(artifact_id).parents
        except StoreError:
            return ()

    def _parent_problem(self, parent: Parent) -> str:
        try:
            found = self.header(parent.id).content_sha256
        except StoreError as error:
            return f"parent {parent.id}: {error.message}"
        recorded = parent.content_sha256
        return "" if found == recorded else f"parent {parent.id} is now {found[:12]}, recorded was {recorded[:12]}"


def _age(header: Header) -> tuple[str, int, ArtifactId]:
    return header.created_utc, header.id.version, header.id
