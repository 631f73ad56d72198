"""A transfer: a composition, or bare skills, on robots that differ from the simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.kinds.compose import COMPOSE
from skillcli.kinds.embed_means import EMBED_MEANS
from skillcli.kinds.outcome import Distances, Outcome, check_domain_name, check_rate
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.record import Interval, Measured, Record, optional, rest
from skillcli.kinds.spec import COUNT, Array, Field, KindSpec, Sizes

MOST_DOMAINS = 100
"""Most domains of one transfer: a picture has a part for each."""


@dataclass(frozen=True, kw_only=True)
class SourceResults(Record):
    """The same episodes in the simulation that was planned in."""

    success_rate: float
    episodes: int
    final_distance_m: float
    success_rate_within_limits: float | None = optional(None)
    violations: Mapping[str, int] = optional({})  # episodes that violate each limit; empty if unknown


@dataclass(frozen=True, kw_only=True)
class WorstEpisode(Record):
    """An episode that ended far from its target."""

    episode: int  # number in the whole recording
    final_distance_m: float | None  # None: its simulation diverged
    success: bool
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Alone(Outcome):
    """A domain with one of its parameters alone."""

    parameter: str


@dataclass(frozen=True, kw_only=True)
class DomainResults(Outcome):
    """One domain compared with the source."""

    name: str
    retention: float | None  # target success over source success; None where that is zero
    gap: float | None = optional(None)  # source success minus target success
    gap_ci95: Interval | None = optional(None)
    successes_within_limits: int | None = optional(None)
    violations: Mapping[str, int] = optional({})  # episodes that violate each limit; empty if unknown
    replay_error_m: Distances | None = optional(None)
    worst: tuple[WorstEpisode, ...] = optional(())  # the farthest first
    parameters: Mapping[str, str]
    sensitivity: tuple[Alone, ...] | None = optional(None)  # None: not asked for


@dataclass(frozen=True, kw_only=True)
class TargetRobot(Record):
    """Another robot that ran the episodes."""

    file: str
    fingerprint: str
    more: Mapping[str, Any] = rest()


@dataclass(frozen=True, kw_only=True)
class TransferEvalResults(Record):
    """Results of a transfer."""

    source: SourceResults
    domains: tuple[DomainResults, ...]
    robot: TargetRobot | None = optional(None, null=True)  # None: the source's
    replanned: bool = optional(False)


@dataclass(frozen=True, kw_only=True)
class TransferEvalMeasured(Measured):
    """Cost of replanning, and where the robot file lay: it may lie elsewhere on another machine."""

    seconds_per_plan: float | None = optional(None)
    robot_file: str | None = optional(None)  # the whole path, or the name of a bundled robot


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    domains = results["domains"]
    names, episodes = [domain["name"] for domain in domains], [domain["episodes"] for domain in domains]
    total = sizes["trajectories: episode"]
    if not names or len(set(names)) < len(names) or not all(count > 0 for count in episodes) or sum(episodes) != total:
        yield f"results.domains does not divide {total} episodes among domains of different names"
    elif not np.array_equal(arrays["episodes/domain"], np.repeat(np.arange(len(names)), episodes)):
        yield "episodes/domain is not as results.domains says"
    if len(names) > MOST_DOMAINS:
        yield f"results.domains has {len(names)} domains, at most {MOST_DOMAINS} are read"
    drawn = dict(zip(names, episodes, strict=True))
    widths: dict[str, tuple[int, ...]] = {}
    for path, array in arrays.items():
        if path.startswith("domains/"):
            _, name, parameter = path.split("/")
            if len(array) != drawn.get(name, -1):
                yield f"{path} has {len(array)} episodes, results.domains has {drawn.get(name, 'none')}"
            if array.shape[1:] != widths.setdefault(parameter, array.shape[1:]):
                yield f"{path} has {array.shape[1:]} values in each episode, another domain {widths[parameter]}"
    for domain in domains:
        yield from check_domain_name(domain["name"], "results.domains")
        yield from check_rate(domain, domain["episodes"])
        if not all(0 <= each["episode"] < total for each in domain.get("worst", ())):
            yield "results.domains names an episode that does not exist"
    if results["source"]["episodes"] < 1:
        yield "results.source has no episodes"


TRANSFER_EVAL = KindSpec(
    name="transfer-eval",
    version=1,
    fields={
        "domains/*/*": Field("episode,...", required=False),
        "episodes/domain": Field("episode", values=COUNT),
        "episodes/final_distance": Field("episode", "m"),
        "episodes/replay_error": Field("episode", "m", required=False),
        "episodes/return": Field("episode"),
        "episodes/*": Field("episode,...", required=False),
        **TRAJECTORIES,
    },
    results=TransferEvalResults,
    measured=TransferEvalMeasured,
    made_from=(COMPOSE.name, EMBED_MEANS.name, PRETRAIN.name),
    check=_check,
)
