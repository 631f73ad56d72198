"""Progress of long work."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Progress:
    """The progress of a stage."""

    stage: str
    done: int  # units of work
    total: int
    unit: str  # what is counted, for example "iterations"
    rate: float = 0.0  # control steps per second
    success: Mapping[str, float] = field(default_factory=dict)  # by skill or domain
    note: str = ""
    physics_share: float | None = None  # sampling rate over that of the bare engine so far
    scalars: Mapping[str, float] = field(default_factory=dict)  # this point of the learning curves


OnProgress = Callable[[Progress], None]


def silent(_: Progress) -> None:
    """Ignore progress."""
