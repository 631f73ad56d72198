"""What may go from a store: older versions that nothing kept was made from, and what killed processes left behind."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from skillcli.store.artifact import Header, Unreadable
from skillcli.store.atomic import TEMPORARY, is_left_over, storage_errors, sync_folder
from skillcli.store.ids import ArtifactId
from skillcli.store.lock import locked
from skillcli.store.store import Store

FINISHED_SECONDS = 3600.0
"""A checkpoint whose training is finished goes after this long without a change: a repetition may be writing it."""

_CHECKPOINT = re.compile(r"\.checkpoint-(?P<kind>[a-z-]+)-(?P<inputs>[0-9a-f]{12})\.h5", re.ASCII)


@dataclass(frozen=True)
class Leftover:
    """A file that is not an artifact and is of no more use."""

    path: Path
    bytes: int
    why: str


@dataclass(frozen=True)
class Garbage:
    """What would go, what stands in the way, and what is kept although it is not finished."""

    artifacts: list[Header]  # whatever was made from one stands before it
    leftovers: list[Leftover]
    unreadable: list[Unreadable]  # as long as there are any, no artifact goes: they may be made from it
    unfinished: list[Path]  # checkpoints of interrupted work

    @property
    def bytes(self) -> int:
        """What would be won."""
        return sum(one.bytes for one in self.artifacts) + sum(one.bytes for one in self.leftovers)


def find_garbage(store: Store, keep: int = 1) -> Garbage:
    """Look, and change nothing.

    Args:
        store: where.
        keep: how many of the newest versions of each NAME/STAGE stay; pins and ancestors of what stays do so too.

    Raises:
        StoreError: the store cannot be listed.
    """
    headers, unreadable = store.listing()
    known = {header.id: header for header in headers}
    kept = _with_ancestors(known, {*_newest(known, keep), *store.pinned()})
    going = [] if unreadable else [header for header in headers if header.id not in kept]
    going.sort(key=lambda header: len(_with_ancestors(known, {header.id})), reverse=True)
    finished = {(header.id.name, header.kind, header.inputs_sha256[:12]) for header in headers}
    leftovers, unfinished = [], []
    with storage_errors(f"list {store.root}"):
        for path in _hidden(store.root):
            found = _CHECKPOINT.fullmatch(path.name)
            age = time.time() - path.lstat().st_mtime
            if path.name.startswith(TEMPORARY) and is_left_over(path):
                leftovers.append(Leftover(path, path.lstat().st_size, "left by a process that was killed"))
            elif found and (path.parent.name, found["kind"], found["inputs"]) in finished and age > FINISHED_SECONDS:
                leftovers.append(Leftover(path, path.lstat().st_size, "checkpoint of a finished training"))
            elif found:
                unfinished.append(path)
    return Garbage(going, leftovers, unreadable, unfinished)


def collect_garbage(store: Store, keep: int = 1) -> Garbage:
    """Remove what `find_garbage` finds, and return it.

    Raises:
        StoreError: the store is locked, or the disk refuses.
    """
    with locked(store.root):
        garbage = find_garbage(store, keep)
        for header in garbage.artifacts:
            store.unlink(header.id)
        for leftover in garbage.leftovers:
            with storage_errors(f"remove {leftover.path}"):
                leftover.path.unlink(missing_ok=True)
        for folder in {leftover.path.parent for leftover in garbage.leftovers}:
            with storage_errors(f"flush {folder}"):
                sync_folder(folder)
    return garbage


def _newest(known: Iterable[ArtifactId], keep: int) -> list[ArtifactId]:
    series: dict[str, list[ArtifactId]] = {}
    for one in sorted(known):
        series.setdefault(one.series, []).append(one)
    return [one for versions in series.values() for one in versions[-keep:]]


def _with_ancestors(known: Mapping[ArtifactId, Header], ids: Iterable[ArtifactId]) -> set[ArtifactId]:
    found: set[ArtifactId] = set()
    pending = list(ids)
    while pending:
        one = pending.pop()
        if one not in found:
            found.add(one)
            pending += [parent.id for parent in known[one].parents] if one in known else []
    return found


def _hidden(root: Path) -> list[Path]:
    """Files that begin with a dot, in the store's folder and in those of its names."""
    if not root.exists():
        return []
    folders = [root, *(folder for folder in root.iterdir() if folder.is_dir() and not folder.name.startswith("."))]
    return sorted(path for folder in folders for path in folder.glob(".*") if path.is_file() and not path.is_symlink())
