"""The artifact store: a folder of files that are written once, checked whenever they are read, and never overwritten."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.kinds import KINDS, kind_spec
from skillcli.store import atomic, codec, container, listing, pins, schema
from skillcli.store.artifact import Artifact, Draft, Header, Parent, Unreadable, content_hash
from skillcli.store.atomic import storage_errors
from skillcli.store.ids import ArtifactId, check_name
from skillcli.store.listing import Listing
from skillcli.store.lock import locked
from skillcli.store.migrate import migrated
from skillcli.store.resolve import first_step, match, unknown


@dataclass(frozen=True)
class Store:
    """The artifacts below one folder, which is created at the first write.

    Args:
        root: the folder.
    """

    root: Path

    def __post_init__(self) -> None:
        """Take the folder as text too: programs give it so."""
        object.__setattr__(self, "root", Path(self.root))

    def write(self, draft: Draft) -> Artifact:
        """Store a result under the next version of its name and kind.

        Returns:
            The artifact as read back from the disk.

        Raises:
            StoreError: the draft does not fit its kind, a parent is missing, or the disk refuses. Nothing is left under the
                artifact's name.
        """
        draft = codec.check_draft(draft)
        parents = tuple(Parent(parent, self.header(parent).content_sha256) for parent in draft.parents)
        version = atomic.claim_version(self.root / check_name(draft.name), draft.kind)
        return self.put(codec.finish(draft, version, parents), parents)

    def put(
        self,
        artifact: Artifact,
        needed: Sequence[Parent] = (),
        *,
        admit: Callable[[], None] = lambda: None,
        replace: bool = False,
    ) -> Artifact:
        """Store a finished artifact under its own id, whose version the caller has claimed.

        Args:
            artifact: what to store.
            needed: parents that must still be in the store, unchanged, when the artifact gets its name.
            admit: called under the lock before that; may raise to refuse it.
            replace: whether a file with this id may be replaced.

        Raises:
            StoreError: see `write`.
        """

        def check(path: Path) -> Artifact:
            written = codec.read_artifact(path, artifact.id, older=True)
            if content_hash(written) != artifact.content_sha256:
                raise StoreError(f"{artifact.id} read back differs from what was written", "check the disk")
            return written

        naming, path = self._naming(artifact.id, needed, admit), self.path(artifact.id)
        return atomic.write_atomically(path, codec.encode(artifact), check, replace=replace, naming=naming)

    @contextmanager
    def _naming(self, artifact_id: ArtifactId, needed: Sequence[Parent], admit: Callable[[], None]) -> Iterator[None]:
        """Hold the lock while an artifact gets its name, so that nobody removes its parents."""
        with locked(self.root, take_over=True) as still_held:
            for parent in needed:
                if problem := self.parent_problem(parent):
                    raise StoreError(f"cannot write {artifact_id}: {problem}", "it was removed meanwhile: do it again")
            admit()
            still_held()
            yield

    def migrate(self, artifact_id: ArtifactId, command: str) -> Artifact:
        """Make a new version of an artifact in the present schema; the original is kept, and so are the parents.

        Raises:
            StoreError: it has the present schema or a newer one, is damaged, or the store refuses.
        """
        old = codec.read_artifact(self._existing(artifact_id), artifact_id, older=True)
        draft = codec.check_draft(migrated(old, command))
        version = atomic.claim_version(self.root / artifact_id.name, draft.kind)
        return self.put(codec.finish(draft, version, old.parents))

    def current(self, artifact_id: ArtifactId) -> ArtifactId:
        """Return the artifact itself or, if its schema is older, the newest one that was migrated from it.

        Raises:
            StoreError: the artifact is missing or damaged.
        """
        header = self.header(artifact_id)
        if not schema.is_older(header.kind, header.schema_version):
            return artifact_id
        later = [newer for newer in reversed(self.versions(artifact_id)) if newer.version > artifact_id.version]
        return next((newer for newer in later if self._origin(newer) == header.content_sha256), artifact_id)

    def _origin(self, artifact_id: ArtifactId) -> str:
        """Return the content hash of the original of a migrated artifact, "" for any other."""
        try:
            return str(self.read(artifact_id).origin.get("content_sha256", ""))
        except StoreError:
            return ""

    def check_writable(self, name: str) -> None:
        """Check before the work whether its result could be written.

        Raises:
            StoreError: it could not, the name is invalid, or one of its stages has had its last version.
        """
        folder = self.root / check_name(name)
        atomic.try_writing(folder)
        with storage_errors(f"list {folder}"):
            for stage in KINDS:
                atomic.next_version(folder, stage)

    def path(self, artifact_id: ArtifactId) -> Path:
        """Return the file of an artifact."""
        return artifact_id.path(self.root)

    def checkpoint_path(self, name: str, kind: str, inputs_sha256: str) -> Path:
        """Return the checkpoint file of unfinished work with these inputs."""
        return self.root / check_name(name) / f".checkpoint-{kind}-{inputs_sha256[:12]}.h5"

    def ids(self) -> list[ArtifactId]:
        """Return the ids of all artifacts, sorted, without opening any."""
        return listing.look(self.root).ids

    def versions(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """Return every artifact of the same NAME/STAGE by version."""
        with storage_errors(f"list {self.root}"):
            return listing.versions(self.root, artifact_id)

    def newest(self, name: str, kind: str) -> ArtifactId | None:
        """Return the newest artifact of a name and kind; None if there is none."""
        found = self.versions(ArtifactId(name, kind, 1))
        return found[-1] if found else None

    def strangers(self) -> list[Path]:
        """Return files and folders in the store that do not belong to it."""
        return listing.look(self.root).strangers

    def resolve(self, text: str | None, kinds: Sequence[str] = ()) -> ArtifactId:
        """Resolve what a user typed.

        Args:
            text: a full id, `NAME/STAGE` for its newest version, or a unique prefix; None or "" for the newest of all.
            kinds: accepted kinds; empty for any.

        Raises:
            UnknownArtifact: the text matches nothing, or more than one.
            StoreError: it is not an id, or of another kind.
        """
        if text:
            return match(text, self.ids(), kinds)
        fitting = [header.id for header in self.headers() if not kinds or header.kind in kinds]
        if not fitting:
            wanted = " or ".join(kinds) or "any kind"
            raise UnknownArtifact(f"there is no artifact of {wanted} in {self.root}", first_step(kinds, self.ids()))
        return fitting[-1]

    def header(self, artifact_id: ArtifactId) -> Header:
        """Read the header of an artifact without opening its HDF5.

        Raises:
            UnknownArtifact: there is none.
            StoreError: its header is damaged.
        """
        self._existing(artifact_id)
        return self._header(artifact_id)

    def read(self, artifact_id: ArtifactId) -> Artifact:
        """Read a whole artifact; a damaged or hostile file is refused before its data is used.

        Raises:
            UnknownArtifact: there is none.
            StoreError: it is damaged or refused.
        """
        return codec.read_artifact(self._existing(artifact_id), artifact_id)

    def listing(self) -> Listing:
        """Return all headers, newest last, and the files and folders that could not be read."""
        names = listing.look(self.root)
        headers, unreadable = [], list(names.closed)
        for artifact_id in names.ids:
            try:
                headers.append(self._header(artifact_id))
            except StoreError as error:
                if os.path.lexists(self.path(artifact_id)):  # not removed meanwhile
                    unreadable.append(Unreadable(artifact_id, error.message))
        return Listing(listing.newest_last(headers), unreadable)

    def headers(self) -> list[Header]:
        """Return the headers of all readable artifacts, newest last."""
        return self.listing().headers

    def find(self, kind: str, inputs_sha256: str, name: str | None = None) -> list[ArtifactId]:
        """Find artifacts of this kind and the present schema whose headers claim these inputs, newest first.

        Anyone can write a header: before reusing one, compare it with its content, see `skillcli.evaluation.reuse`.
        """
        if not inputs_sha256:
            return []
        version = kind_spec(kind).version
        wanted = (kind, version, inputs_sha256)
        headers = self.headers() if name is None else self._series(ArtifactId(name, kind, 1))
        same = [header for header in headers if (header.kind, header.schema_version, header.inputs_sha256) == wanted]
        return [header.id for header in reversed(same)]

    def _series(self, artifact_id: ArtifactId) -> list[Header]:
        """Return the readable headers of one NAME/STAGE by version, without a look at the rest of the store."""
        found = []
        for one in self.versions(artifact_id):
            with suppress(StoreError):
                found.append(self._header(one))
        return found

    def lineage(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """Return all ancestors, nearest first; a missing one is named, but its own ancestors are unknown.

        Raises:
            StoreError: the artifact itself is missing or damaged.
        """
        found: dict[ArtifactId, None] = {}
        pending = deque(parent.id for parent in self.header(artifact_id).parents)
        while pending:
            ancestor = pending.popleft()
            if ancestor not in found:
                found[ancestor] = None
                pending += [parent.id for parent in self._parents(ancestor)]
        return list(found)

    def dependents(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """Return the direct children of an artifact, oldest first, as far as headers can be read."""
        return self._dependents(artifact_id, lambda _: False)

    def verify(self, artifact_id: ArtifactId, check: Callable[[Artifact], None] = lambda _: None) -> list[str]:
        """List what is wrong with an artifact, one line each; nothing if it is as it was written.

        Args:
            artifact_id: which one.
            check: called with it; may raise a StoreError.

        Raises:
            UnknownArtifact: there is none.
        """
        path = self._existing(artifact_id)
        try:
            artifact = codec.read_artifact(path, artifact_id, older=True)
            check(artifact)
        except StoreError as error:
            return [error.message]
        problems = [self.parent_problem(parent) for parent in artifact.parents]
        if content_hash(artifact) != artifact.content_sha256:
            problems.append(f"the content hash of {artifact_id} is not that of its content")
        return [problem for problem in problems if problem]

    def verify_all(self, check: Callable[[Artifact], None] = lambda _: None) -> dict[ArtifactId | str, list[str]]:
        """List what is wrong with each artifact and each folder that cannot be listed; what vanishes meanwhile is left out.

        Args:
            check: see `verify`.

        Raises:
            StoreError: the store's folder itself cannot be listed.
        """
        names = listing.look(self.root)
        problems: dict[ArtifactId | str, list[str]] = {folder.id: [folder.problem] for folder in names.closed}
        for artifact_id in names.ids:
            with suppress(UnknownArtifact):
                problems[artifact_id] = self.verify(artifact_id, check)
        return problems

    def parent_problem(self, parent: Parent) -> str:
        """Return why a parent no longer fits its child; "" if it is unchanged."""
        try:
            found = self.header(parent.id).content_sha256
        except StoreError as error:
            return f"parent {parent.id}: {error.message}"
        recorded = parent.content_sha256
        return "" if found == recorded else f"parent {parent.id} is now {found[:12]}, recorded was {recorded[:12]}"

    def remove(self, artifact_id: ArtifactId) -> None:
        """Delete an artifact; its version number stays taken.

        Raises:
            UnknownArtifact: there is none.
            StoreError: it is pinned or has children, the store is locked, or the disk refuses.
        """
        self._existing(artifact_id)
        with locked(self.root) as still_held:
            if self.is_pinned(artifact_id):
                raise StoreError(f"cannot remove {artifact_id}: it is pinned", f"`skill unpin {artifact_id}` first")
            if needing := self._needing(artifact_id):
                names = ", ".join(map(str, needing[:5])) + (" and more" if len(needing) > 5 else "")
                verb = "was" if len(needing) == 1 else "were"
                raise StoreError(
                    f"cannot remove {artifact_id}: {names} {verb} made from it", "remove what was made from it first"
                )
            still_held()
            self.unlink(artifact_id)

    def pin(self, artifact_id: ArtifactId, wanted: bool = True) -> None:
        """Protect an artifact from `remove` and from garbage collection, or end the protection.

        Raises:
            UnknownArtifact: there is none.
            StoreError: the store is locked, or the disk refuses.
        """
        self._existing(artifact_id)
        with locked(self.root), storage_errors(f"write in {self.root}"):
            (pins.pin if wanted else pins.unpin)(self._existing(artifact_id))

    def is_pinned(self, artifact_id: ArtifactId) -> bool:
        """Return whether an artifact is pinned, without a look at the rest of the store.

        Raises:
            StoreError: its folder cannot be read.
        """
        with storage_errors(f"look at the pins of {artifact_id}"):
            return pins.is_pinned(self.path(artifact_id))

    def pinned(self) -> set[ArtifactId]:
        """Return all pinned artifacts."""
        return listing.look(self.root).pinned

    def unlink(self, artifact_id: ArtifactId) -> None:
        """Delete the file of an artifact without checks; the caller holds the lock.

        Raises:
            StoreError: the disk refuses.
        """
        path = self.path(artifact_id)
        with storage_errors(f"remove {path}"):
            atomic.remove_claimed(path)

    def _dependents(self, artifact_id: ArtifactId, must_raise: Callable[[StoreError], bool]) -> list[ArtifactId]:
        """Return the children of an artifact; errors of other headers are raised only if `must_raise` says so."""
        candidates = []
        for other in self.ids():
            try:
                if container.may_mention(self._file(other), str(artifact_id)):
                    candidates.append(self._header(other))
            except StoreError as error:
                if must_raise(error):
                    raise
        children = [header for header in candidates if artifact_id in [parent.id for parent in header.parents]]
        return [header.id for header in listing.newest_last(children)]

    def _needing(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        """Return the children of an artifact; in a circle, which only damage can make, nothing counts as a child."""
        dependents = self._dependents(artifact_id, atomic.is_disk_failure)
        circle = {artifact_id, *self._ancestors(artifact_id)} if dependents else set()
        return [child for child in dependents if child not in circle]

    def _ancestors(self, artifact_id: ArtifactId) -> list[ArtifactId]:
        try:
            return self.lineage(artifact_id)
        except StoreError:
            return []

    def _header(self, artifact_id: ArtifactId) -> Header:
        return codec.read_header(self._file(artifact_id), artifact_id)

    def _file(self, artifact_id: ArtifactId) -> str:
        """Return the file of an artifact as a plain string, which is faster: a listing opens thousands."""
        return f"{self.root}/{artifact_id}.h5"

    def _existing(self, artifact_id: ArtifactId) -> Path:
        path = self.path(artifact_id)
        with storage_errors(f"read {path}"):
            try:
                path.lstat()
            except (FileNotFoundError, NotADirectoryError):
                raise unknown(str(artifact_id), self.ids()) from None
        return path

    def _parents(self, artifact_id: ArtifactId) -> tuple[Parent, ...]:
        try:
            return self.header(artifact_id).parents
        except StoreError:
            return ()
