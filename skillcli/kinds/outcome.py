"""How episodes ended; used by several kinds of artifacts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillcli.kinds.record import Interval, Record, optional

DOMAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}", re.ASCII)
"""Name of a domain: part of a path in the file, and of labels in figures."""

_ROUNDING = 1e-9


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
class Turns(Record):
    """How far objects were turned about the vertical, either way, degrees."""

    median: float
    p90: float


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
    final_yaw_deg: Turns | None = optional(None)  # None: no object, no stable episode, or an older one


def check_rate(found: Mapping[str, Any], trials: int) -> Iterator[str]:
    """Report successes, rate and interval that contradict each other."""
    if not 0 <= found["successes"] <= trials:
        yield f"{found['successes']} of {trials} episodes succeed"
    within = found.get("successes_within_limits")
    if within is not None and not 0 <= within <= found["successes"]:
        yield f"{within} of {found['successes']} successes are within the safety limits"
    low, high = found["ci95"]
    if not 0 <= low <= found["success_rate"] + _ROUNDING <= high + 2 * _ROUNDING <= 1 + 3 * _ROUNDING:
        yield f"the success rate {found['success_rate']:g} and its interval {low:g} to {high:g} contradict each other"


def check_domain_name(name: str, where: str) -> Iterator[str]:
    """Report what is not the name of a domain."""
    if not DOMAIN_NAME.fullmatch(name):
        yield f"{where} names one {name[:40]!r}, which is not the name of a domain"
