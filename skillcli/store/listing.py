"""List a store by file names alone, and sort artifacts."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from skillcli.store.artifact import Header, Unreadable
from skillcli.store.atomic import storage_errors
from skillcli.store.ids import NAME, ArtifactId, file_pattern
from skillcli.store.pins import FOLDER as PINS

_FOLDER = re.compile(NAME, re.ASCII)
_SUFFIX = r"\.h5"


class Listing(NamedTuple):
    """The artifacts of a store, newest last, and what cannot be read."""

    headers: list[Header]
    unreadable: list[Unreadable]


class Names(NamedTuple):
    """The files of a store's folder and of the folders below it."""

    ids: list[ArtifactId]
    hidden: list[Path]  # files of skill whose names begin with a dot
    strangers: list[Path]  # files of others
    closed: list[Unreadable]  # folders of names or pins that cannot be listed
    pinned: set[ArtifactId]  # pinned artifacts that exist


def look(root: Path) -> Names:
    """List a store's folder and the folders below it; what vanishes meanwhile is left out, what cannot be listed is named.

    Raises:
        StoreError: the store's folder itself cannot be listed.
    """
    found = Names([], [], [], [], set())
    with storage_errors(f"list {root}"):
        entries = list(os.scandir(root)) if root.exists() else []
    for entry in sorted(entries, key=lambda one: one.name):
        with _noted(found, f"{entry.name}/", entry.path):
            if not entry.name.startswith(".") and _FOLDER.fullmatch(entry.name) and entry.is_dir():
                _look_into(entry, found)
            else:
                _sort_out(entry, found)
    found.ids.sort(key=lambda one: (one.name, one.stage, one.version))
    return found


def versions(root: Path, artifact_id: ArtifactId) -> list[ArtifactId]:
    """Return every artifact of the same NAME/STAGE by version.

    Raises:
        OSError: the folder cannot be listed.
    """
    try:
        names = [path.name for path in (root / artifact_id.name).iterdir()]
    except FileNotFoundError:
        return []
    file = file_pattern(after=_SUFFIX)
    found = (match for name in names if (match := file.fullmatch(name)) and match["stage"] == artifact_id.stage)
    return [replace(artifact_id, version=number) for number in sorted(int(match["version"]) for match in found)]


def newest_last(headers: Iterable[Header]) -> list[Header]:
    """Sort headers by time; within one NAME/STAGE by version, even if a clock was set back."""
    latest: dict[tuple[str, str], str] = {}
    timed = []
    for header in sorted(headers, key=lambda one: one.id.version):
        series = (header.id.name, header.id.stage)
        latest[series] = max(latest.get(series, ""), header.created_utc)
        timed.append(((latest[series], header.id.version, *series), header))
    return [header for _, header in sorted(timed, key=lambda one: one[0])]


@contextmanager
def _noted(found: Names, name: str, path: str) -> Iterator[None]:
    """Note a folder that cannot be listed, unless it has vanished."""
    try:
        yield
    except FileNotFoundError:
        pass
    except OSError as error:
        found.closed.append(Unreadable(name, f"cannot list {path}: {error.strerror or error}"))


def _look_into(folder: os.DirEntry[str], found: Names) -> None:
    pins: list[str] = []
    own: dict[str, ArtifactId] = {}
    file = file_pattern(after=_SUFFIX)
    with os.scandir(folder.path) as entries:
        for entry in entries:
            if match := file.fullmatch(entry.name):
                own[entry.name[:-3]] = ArtifactId(folder.name, match["stage"], int(match["version"]))
            elif entry.name == PINS:
                with _noted(found, f"{folder.name}/{PINS}/", entry.path):
                    pins = os.listdir(entry.path)  # noqa: PTH208 - no paths are needed
            else:
                _sort_out(entry, found)
    found.ids.extend(own.values())
    found.pinned.update(own[pin] for pin in pins if pin in own)


def _sort_out(entry: os.DirEntry[str], found: Names) -> None:
    if not entry.name.startswith("."):
        found.strangers.append(Path(entry.path))
    elif entry.is_file(follow_symlinks=False):
        found.hidden.append(Path(entry.path))
