"""stdout and stderr that never stop the work: what cannot be encoded is replaced, and a reader that is gone is remembered."""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from typing import TextIO


class Outlet(io.RawIOBase):
    """A file descriptor that takes everything, and keeps in mind what went wrong.

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
            except BlockingIOError:  # a pipe that its other end has set so: wait until there is room
                select.select([], [self.number], [])
                return self.write(data)
            except OSError as error:
                self.trouble = error
        return len(view)

    def writable(self) -> bool:
        """Yes."""
        return True

    def fileno(self) -> int:
        """The descriptor."""
        return self.number

    def isatty(self) -> bool:
        """Whether a person sees it."""
        return os.isatty(self.number)


def protect() -> Outlet:
    """Put both streams behind outlets, and see to it that no file takes the place of a closed one; returns that of stdout."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
    out = Outlet(1)
    sys.stdout = _text(out, sys.stdout, "replace")
    sys.stderr = _text(Outlet(2), sys.stderr, "backslashreplace", by_line=True)
    return out


def lost(out: Outlet) -> OSError | None:
    """What kept results from being written; a reader that has seen enough (`skill ls | head -1`) is no failure."""
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
