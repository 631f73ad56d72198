"""The files of a shared store: what one must be able to do with them, and how a folder of this machine does it."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

from skillcli.errors import StoreError
from skillcli.paths import open_regular
from skillcli.store import atomic
from skillcli.store.atomic import storage_errors

_HINTS = {
    **dict.fromkeys(atomic.FULL, "the disk of the shared store is full: free some space there, or choose another address"),
    **dict.fromkeys((errno.EACCES, errno.EPERM), "ask its owner to let you read and write there, or choose another address"),
    **dict.fromkeys((errno.ENOTDIR, errno.EEXIST), "a file lies where a folder is needed: check the address"),
    errno.EROFS: "the file system is read-only: choose another address",
}


class Files(Protocol):
    """Files below one folder, named by paths relative to it.

    Every method raises a StoreError if disk, network or permissions refuse.
    """

    @property
    def address(self) -> str:
        """Return the address as it may be shown, without a password."""

    def names(self, folder: str) -> list[str]:
        """Return the names of all whole files below a folder; none if the folder is missing."""

    def read(self, name: str, most: int) -> bytes | None:
        """Return at most so many bytes from the start of a file, and one more if it is longer; None if it is missing."""

    def write(self, name: str, data: bytes) -> None:
        """Write a file, which others see whole or not at all; an earlier one is replaced."""

    def create(self, name: str, data: bytes) -> bool:
        """Write a file in the same way, unless there is one; of two who do so at once, one gets False."""


class LocalFiles:
    """Files of a folder that this machine has mounted.

    Args:
        root: the folder; created at the first write if its own parent exists.
        address: as typed.
    """

    def __init__(self, root: Path, address: str) -> None:
        self.root = root
        self.address = address
        self._tidy: set[Path] = set()

    def names(self, folder: str) -> list[str]:
        """See `Files`."""
        start = self.root / folder
        with _refusals(f"list {start}"):
            if not start.exists():
                return []
            paths = [path for path in start.rglob("*") if not path.name.startswith(".") and path.is_file()]
        return [path.relative_to(self.root).as_posix() for path in paths]

    def read(self, name: str, most: int) -> bytes | None:
        """See `Files`."""
        path = self.root / name
        with _refusals(f"read {path}"):
            try:
                with open_regular(path) as file:
                    return b"".join(iter(lambda: file.read(min(1 << 20, most + 1 - file.tell())), b""))
            except FileNotFoundError:
                return None
            except ValueError as error:
                raise StoreError(f"cannot read {path}: {error}", "it was not made by skill: remove it") from error

    def write(self, name: str, data: bytes) -> None:
        """See `Files`."""
        path = self._with_folder(name)
        with _refusals(f"write {path}"):
            atomic.write_atomically(path, memoryview(data), Path.stat, replace=True)

    def create(self, name: str, data: bytes) -> bool:
        """See `Files`."""
        path = self._with_folder(name)
        with _refusals(f"write {path}"):
            return atomic.create_whole(path, data)

    def _with_folder(self, name: str) -> Path:
        """Return the path of a file in a folder that exists; once, remove what killed processes left there."""
        path = self.root / name
        with _refusals(f"write {path}"):
            if not self.root.parent.is_dir():  # what is not mounted must not be filled
                raise StoreError(
                    f"cannot write to {self.address}: there is no folder {self.root.parent}", "create it, or check the address"
                )
            atomic.make_folder(path.parent)
        if path.parent not in self._tidy:
            self._tidy.add(path.parent)
            with suppress(OSError):
                atomic.sweep(path.parent)
        return path


@contextmanager
def _refusals(action: str) -> Iterator[None]:
    """Turn an error of the operating system into a StoreError with advice about the shared store."""
    try:
        with storage_errors(action):
            yield
    except StoreError as error:
        number = error.__cause__.errno if isinstance(error.__cause__, OSError) else None
        raise StoreError(error.message, _HINTS.get(number or 0, error.hint)) from error.__cause__
