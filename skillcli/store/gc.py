"""Find and remove garbage: older versions without children that are kept, and files of killed processes."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from skillcli.store import listing
from skillcli.store.artifact import Header, Unreadable
from skillcli.store.atomic import LEFT_OVER_SECONDS, TEMPORARY, is_left_over, storage_errors, sync_folder
from skillcli.store.ids import ArtifactId
from skillcli.store.lock import locked
from skillcli.store.store import Store

GRACE_SECONDS = 3600.0
"""Younger files stay: the next stage of a chain, or an import, may need them soon. The checkpoint of a finished training
stays as long, because a repetition may be writing it."""

HOLD_SECONDS = 2.0
"""After so long, removal releases the lock to others, and then searches again."""

_PAUSE_SECONDS = 0.1
_CHECKPOINT = re.compile(r"\.checkpoint-(?P<kind>[a-z-]+)-(?P<inputs>[0-9a-f]{12})\.h5", re.ASCII)
_DRAWING = re.compile(r"\..+-[a-z0-9_]{8}\.(rrd|png|pdf|svg)", re.ASCII)  # names of unfinished files, as `tempfile` makes them


@dataclass(frozen=True)
class Leftover:
    """A file that is not an artifact and no longer useful."""

    path: Path
    bytes: int
    why: str


@dataclass(frozen=True)
class Garbage:
    """What can be removed, what prevents removal, and unfinished work that is kept."""

    artifacts: list[Header]  # children before their parents
    leftovers: list[Leftover]
    unreadable: list[Unreadable]  # if there are any, no artifact is removed: they may be its children
    unfinished: list[Path]  # checkpoints of interrupted work
    young: list[Header]  # garbage, but younger than GRACE_SECONDS

    @property
    def bytes(self) -> int:
        """Bytes to be freed."""
        return sum(one.bytes for one in self.artifacts) + sum(one.bytes for one in self.leftovers)


def find_garbage(store: Store, keep: int = 1) -> Garbage:
    """Find garbage and change nothing.

    Args:
        store: where to look.
        keep: how many of the newest versions of each NAME/STAGE stay; so do pinned and very young artifacts, and the
            ancestors of everything that stays.

    Raises:
        StoreError: the store cannot be listed.
    """
    headers, unreadable = store.listing()
    known = {header.id: header for header in headers}
    kept = _with_ancestors(known, {*_newest(known, keep), *store.pinned()})
    with storage_errors(f"list {store.root}"):
        young = [header for one, header in known.items() if one not in kept and _age(store.path(one)) < GRACE_SECONDS]
        leftovers, unfinished = _left_behind(store, headers)
    kept |= _with_ancestors(known, [header.id for header in young])
    going = {} if unreadable else {one: header for one, header in known.items() if one not in kept}
    return Garbage(_children_first(going), leftovers, unreadable, unfinished, young)


def collect_garbage(store: Store, keep: int = 1) -> Garbage:
    """Remove what `find_garbage` finds, and return it.

    The lock is held for `HOLD_SECONDS` at a time. Another process may then need an artifact that was garbage before, so the
    search is repeated each time.

    Raises:
        StoreError: the store is locked, or the disk refuses.
    """
    artifacts: list[Header] = []
    leftovers: list[Leftover] = []
    while True:
        with locked(store.root) as still_held:
            found = find_garbage(store, keep)
            gone = _remove(store, found.artifacts, still_held)
            _remove_leftovers(found.leftovers)
        artifacts += gone
        leftovers += found.leftovers
        if len(gone) == len(found.artifacts):
            return replace(found, artifacts=artifacts, leftovers=leftovers)
        _let_others_in()


def _let_others_in() -> None:
    time.sleep(_PAUSE_SECONDS)


def _remove(store: Store, headers: list[Header], still_held: Callable[[], None]) -> list[Header]:
    """Remove artifacts one by one until the time is over; return the removed ones."""
    end = time.monotonic() + HOLD_SECONDS
    for count, header in enumerate(headers):
        if count and time.monotonic() > end:
            return headers[:count]
        still_held()  # on a slow disk a writer may have taken over the lock
        store.unlink(header.id)
    return headers


def _remove_leftovers(leftovers: list[Leftover]) -> None:
    for leftover in leftovers:
        with storage_errors(f"remove {leftover.path}"):
            leftover.path.unlink(missing_ok=True)
    for folder in {leftover.path.parent for leftover in leftovers}:
        with storage_errors(f"flush {folder}"):
            sync_folder(folder)


def _left_behind(store: Store, headers: Iterable[Header]) -> tuple[list[Leftover], list[Path]]:
    """List useless files, and checkpoints that are still useful."""
    finished = {(header.id.name, header.kind, header.inputs_sha256[:12]) for header in headers}
    leftovers, unfinished = [], []
    for path in listing.look(store.root).hidden:
        found = _CHECKPOINT.fullmatch(path.name)
        if found and (path.parent.name, found["kind"], found["inputs"]) not in finished:
            unfinished.append(path)
        elif why := _why(path, bool(found)):
            leftovers.append(Leftover(path, _bytes(path), why))
    return leftovers, unfinished


def _why(path: Path, finished: bool) -> str:
    """Return why a hidden file is useless; "" if it may be useful."""
    if finished:
        return "checkpoint of a finished training" if _age(path) > GRACE_SECONDS else ""
    killed = is_left_over(path) if path.name.startswith(TEMPORARY) else False
    drawn = _DRAWING.fullmatch(path.name) and _age(path) > LEFT_OVER_SECONDS
    return "left by a process that was killed" if killed or drawn else ""


def _age(path: Path) -> float:
    """Return the seconds since a file was last written, or until then if its time is in the future; 0 if it has vanished."""
    try:
        return abs(time.time() - path.lstat().st_mtime)
    except FileNotFoundError:
        return 0.0


def _bytes(path: Path) -> int:
    try:
        return path.lstat().st_size
    except FileNotFoundError:
        return 0


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


def _children_first(going: Mapping[ArtifactId, Header]) -> list[Header]:
    """Sort so that children come before their parents; circles, which only damage can make, come last."""
    parents = {one: {parent.id for parent in header.parents} & going.keys() for one, header in going.items()}
    children = Counter(parent for each in parents.values() for parent in each)
    ordered = [one for one in reversed(list(going)) if not children[one]]
    for one in ordered:  # grows during the loop
        for parent in parents[one]:
            children[parent] -= 1
            if not children[parent]:
                ordered.append(parent)
    done = set(ordered)
    return [going[one] for one in [*ordered, *(one for one in going if one not in done)]]
