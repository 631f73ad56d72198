"""How episodes ended; used by several kinds of artifacts."""

from __future__ import annotations

from dataclasses import dataclass

from skillcli.kinds.record import Interval, Record, optional


@dataclass(frozen=True, kw_only=True)
class Distances(Record):
    """Final distances of episodes, m; None without stable episodes."""

    mean: float | None
    p10: float | None = optional(None, null=True)
    p25: float | None = optional(None, null=True)
    median: float | None
    p75: float | None = optional(None, null=True)
    p90: float | None


@dataclass(frozen=True, kw_only=True)
class Outcome(Record):
    """Success rate and final distances of episodes."""

    episodes: int
    successes: int
    success_rate: float
    ci95: Interval
    deterministic: bool = optional(False)  # all episodes are the same: the interval has no width
    unstable: int = optional(0)  # episodes in which the simulation diverged
    gave_up: int = optional(0)  # replanned episodes that ended away from their goal
    final_distance_m: Distances
