"""Requests to stop: by Ctrl-C, by a scheduler, or by a terminal that closes."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))
ECHO_SECONDS = 5.0
"""A closing session sends SIGHUP twice, or SIGTERM along with it, within moments: that is one request."""


def heeded() -> list[signal.Signals]:
    """Return the signals that were not ignored when this process began, so that `nohup` works."""
    return [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


class Interrupt:
    """Raises an exception for a signal and remembers it: other code may replace the exception, or swallow it."""

    def __init__(self) -> None:
        self.pressed = False
        self._since = 0.0

    def __call__(self, number: int, __: FrameType | None) -> None:
        """Take a signal; repeated ones would only disturb the cleanup."""
        if self.pressed and number != signal.SIGINT and time.monotonic() - self._since < ECHO_SECONDS:
            return
        self.pressed, self._since = True, time.monotonic()
        raise KeyboardInterrupt


class StopRequest:
    """A request to stop: the first at the next safe point, the second at once.

    A signal that an `Interrupt` took before, and that other code swallowed, is the first.
    """

    def __init__(self) -> None:
        before = [signal.getsignal(number) for number in SIGNALS]
        self.requested = any(isinstance(answer, Interrupt) and answer.pressed for answer in before)
        self._since = time.monotonic() if self.requested else 0.0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        echo = number != signal.SIGINT and time.monotonic() - self._since < ECHO_SECONDS
        if self.requested and not echo:
            raise KeyboardInterrupt
        if not self.requested:
            self.requested, self._since = True, time.monotonic()


@contextmanager
def answered(answer: signal._HANDLER) -> Iterator[None]:
    """Let `answer` take the signals inside the block; outside the main thread, which gets no signals, do nothing."""
    with ExitStack() as stack:
        try:
            for number in heeded():
                stack.callback(signal.signal, number, signal.signal(number, answer))
        except ValueError:  # signals belong to the main thread
            pass
        yield


@contextmanager
def stoppable() -> Iterator[StopRequest]:
    """Turn the first signal inside the block into a request."""
    stop = StopRequest()
    with answered(stop):
        yield stop
