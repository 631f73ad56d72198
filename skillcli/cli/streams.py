"""stdout and stderr that never stop the work: they replace what cannot be encoded, and remember a lost reader."""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from typing import TextIO


class Outlet(io.RawIOBase):
    """A file descriptor that accepts every write and remembers failures.

    A training must not end because the terminal that shows its progress was closed.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.trouble: OSError | None = None

    def write(self, data: object) -> int:
        """Write some of the bytes; after a failure, none."""
        view = memoryview(data).cast("B")  # type: ignore[arg-type]
        if self.trouble is None:
            try:
                return os.write(self.number, view)
            except BlockingIOError:  # the other end made the pipe non-blocking: wait for room
                select.select([], [self.number], [])
                return self.write(data)
            except OSError as error:
                self.trouble = error
        return len(view)

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the descriptor."""
        return self.number

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return os.isatty(self.number)


def protect() -> Outlet:
    """Put both streams behind outlets, reserve the numbers of closed ones, and return the outlet of stdout."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    out = Outlet(1)
    sys.stdout = _text(out, sys.stdout, "replace")
    sys.stderr = _text(Outlet(2), sys.stderr, "backslashreplace", by_line=True)
    return out


def lost(out: Outlet) -> OSError | None:
    """Return the error that lost results; a reader that stops early (`skill ls | head -1`) is not an error."""
    sys.stdout.flush()
    return None if out.trouble and out.trouble.errno == errno.EPIPE else out.trouble


def _text(outlet: Outlet, before: TextIO | None, errors: str, by_line: bool = False) -> TextIO:
    encoding = before.encoding if before is not None else "utf-8"
    return io.TextIOWrapper(
        io.BufferedWriter(outlet),
        encoding=encoding,
        errors=errors,
        line_buffering=by_line or outlet.isatty() or bool(getattr(before, "write_through", False)),
    )
