"""One process at a time for one cell, also where a lost worker still runs while its cell was given to another."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillcli.store.atomic import make_folder, storage_errors

RUNNING = ".running"
"""Name of the file in the folder of a cell that is locked while it runs; the lock ends with the process."""


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Wait until no other process is inside this block for the same folder.

    Raises:
        StoreError: the folder cannot be written.
    """
    path = folder / RUNNING
    with storage_errors(f"write in {folder}"):
        make_folder(folder)
        handle = _locked(path)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(handle)


def _locked(path: Path) -> int:
    """Open and lock a file; if whoever had it before has removed it meanwhile, a new one."""
    while True:
        handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            with suppress(FileNotFoundError):
                if path.stat().st_ino == os.fstat(handle).st_ino:
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
