"""Open files by paths that may come from elsewhere: a stored recipe can name a device, a pipe, or nothing at all."""

from __future__ import annotations

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

LONGEST_PATH = 4095
"""Longest path that Linux opens, bytes: a stored text that is longer names no file."""


def open_regular(path: Path | str) -> BinaryIO:
    """Open a regular file for reading; refuse anything else: a pipe would block for ever, a device may have no end.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is not a regular file, or no path at all.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise ValueError("it is not a file")
    return os.fdopen(handle, "rb", buffering=0)  # callers read large pieces, or a few kilobytes alone


def read_small(path: Path, most: int) -> bytes:
    """Read a whole regular file of at most `most` bytes.

    Raises:
        OSError: it cannot be opened or read.
        ValueError: it is larger, not a regular file, or no path at all.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    with open_regular(path) as file:
        raw = file.read(most + 1)
    if len(raw) > most:
        raise ValueError(f"it is larger than {most // 1024} kB")
    return raw


def expanded(path: Path | str) -> Path:
    """Put the home folder in place of `~` or `~NAME`; without such a user or home, the path stays as it is."""
    with suppress(RuntimeError, ValueError):  # a ValueError where NAME is no text that a system may hold
        return Path(path).expanduser()
    return Path(path)
