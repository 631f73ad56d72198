"""What long work tells while it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


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


OnProgress = Callable[[Progress], None]


def silent(_: Progress) -> None:
    """Tell nobody."""
