"""What long work tells while it runs, and how it is asked to stop."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType


@dataclass(frozen=True)
class Progress:
    """Where a stage stands."""

    stage: str
    done: int  # units of work
    total: int
    unit: str  # what is counted, "iterations" say
    rate: float = 0.0  # control steps per second
    success: Mapping[str, float] = field(default_factory=dict)  # by skill or domain
    note: str = ""
    physics_share: float | None = None  # rate of collecting over that of the bare engine so far
    scalars: Mapping[str, float] = field(default_factory=dict)  # this point of the learning curves


Report = Callable[[Progress], None]


def silent(_: Progress) -> None:
    """Tell nobody."""


class StopRequest:
    """Whether Ctrl-C was pressed: once to stop at the next safe point, twice to stop at once."""

    def __init__(self) -> None:
        self.requested = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True


@contextmanager
def stoppable() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C inside the block into a request; outside the main thread nothing changes."""
    stop = StopRequest()
    try:
        before = signal.signal(signal.SIGINT, stop)
    except ValueError:  # signals belong to the main thread
        yield stop
        return
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
