"""Take several executions of one plan on one arm as the episodes of one experiment."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from skillcli import metrics
from skillcli.kinds import EXECUTION
from skillcli.kinds.execution import ExecutionResults
from skillcli.store import Artifact, ArtifactId


@dataclass(frozen=True)
class Pooled:
    """Episodes of executions that differ in nothing but chance.

    Attributes:
        used: the executions, newest first.
        repeated: executions that are left out, because a newer or longer one of the same seed has the same simulated robots.
        episodes: of those used.
        successes: among them.
        ci95: Wilson's interval of the success rate.
        median: of the final distances, m.
        p90: the same, 90th percentile.
        stopped: why executions did not end by themselves, each reason once.
    """

    used: tuple[Artifact, ...]
    repeated: tuple[ArtifactId, ...]
    episodes: int
    successes: int
    ci95: tuple[float, float]
    median: float
    p90: float
    stopped: tuple[str, ...]

    @property
    def results(self) -> ExecutionResults:
        """Return the results of the newest one: plan, driver, arm and speed are those of all."""
        return EXECUTION.results_of(self.used[0])

    @property
    def success_rate(self) -> float:
        """Return the share of episodes that succeed."""
        return self.successes / self.episodes


def pool(executions: Iterable[Artifact]) -> list[Pooled]:
    """Pool executions of the same plan on the same arm, by the same driver, domain and speed, with replanning or without.

    Simulated arms that were drawn with the same seed are the same arms: of such executions only the longest counts, of several
    the newest. Dry runs send nothing and are left out. So is an episode that somebody interrupted: it says nothing of the plan.

    Args:
        executions: in any order.

    Returns:
        One entry for each plan and arm, in order of the first of its executions.
    """
    groups: dict[tuple[object, ...], list[Artifact]] = {}
    for one in executions:
        found = EXECUTION.results_of(one)
        if not found.dry_run and _counted(one):
            plan = one.parents[0].content_sha256 if one.parents else ""
            how = found.driver, found.robot.fingerprint, found.domain, found.max_speed, found.replanned
            groups.setdefault((plan, *how), []).append(one)
    return [_pooled(group) for group in groups.values()]


def _pooled(group: list[Artifact]) -> Pooled:
    used: dict[object, Artifact] = {}
    longest = sorted(group, key=lambda one: (_counted(one), one.created_utc), reverse=True)
    for one in longest:
        simulated = EXECUTION.results_of(one).domain is not None
        used.setdefault(one.seed if simulated else one.id, one)
    kept = sorted(used.values(), key=lambda one: one.created_utc, reverse=True)
    results = [EXECUTION.results_of(one) for one in kept]
    episodes, successes = sum(map(_counted, kept)), sum(one.successes for one in results)
    distance = np.concatenate([one.arrays["episodes/final_distance"][: _counted(one)] for one in kept])
    return Pooled(
        used=tuple(kept),
        repeated=tuple(one.id for one in longest if one not in kept),
        episodes=episodes,
        successes=successes,
        ci95=metrics.wilson_interval(successes, episodes),
        median=float(np.median(distance)),
        p90=float(np.quantile(distance, 0.9)),
        stopped=tuple(dict.fromkeys(one.stopped.reason for one in results if one.stopped is not None)),
    )


def _counted(one: Artifact) -> int:
    """Return how many episodes of an execution count: the last one does not if somebody interrupted it."""
    found = EXECUTION.results_of(one)
    stop = found.stopped
    cut_short = stop is not None and stop.reason == "interrupted" and stop.episode == found.episodes - 1
    return found.episodes - cut_short
