"""Compute the results of a transfer: pure functions over recordings."""

from __future__ import annotations

import numpy as np

from skillcli import metrics
from skillcli.config.randomization import MANNERS, NEEDS, PARAMETERS
from skillcli.evaluation.transfer_evaluator import TargetRobots
from skillcli.kinds.outcome import Distances, Outcome, Turns
from skillcli.kinds.transfer_eval import Alone, DomainResults, SourceResults, WorstEpisode
from skillcli.trajectories import Array, Trajectories

WORST = 5  # episodes listed as the worst


def summarize_source(reference: Trajectories) -> SourceResults:
    """Summarize the episodes in the simulation that was planned in."""
    return SourceResults(
        success_rate=float(reference.success.mean()),
        episodes=reference.episodes,
        final_distance_m=float(metrics.final_distance(reference).mean()),
        success_rate_within_limits=float((reference.success & reference.within_limits).mean()),
        violations=count_violations(reference),
    )


def summarize_domain(
    target: TargetRobots,
    recording: Trajectories,
    replay_error: Array,
    source_rate: float,
    first: int,
    sensitivity: tuple[Alone, ...] | None = None,
) -> DomainResults:
    """Summarize one domain and compare it with the source.

    Args:
        target: the drawn robots.
        recording: E episodes on them.
        replay_error: (E,) m, see `TransferEvaluator.replay`.
        source_rate: success rate in the source, which is exact: nothing is random there.
        first: number of its first episode in the artifact.
        sensitivity: the same with one parameter alone, if asked for.
    """
    found = outcome(recording, target.repeats)
    rate = found.success_rate
    return DomainResults(
        **vars(found),
        name=target.name,
        retention=rate / source_rate if source_rate > 0 else None,
        gap=source_rate - rate,
        gap_ci95=metrics.difference_interval(source_rate, (source_rate, source_rate), rate, found.ci95),
        successes_within_limits=int((recording.success & recording.within_limits).sum()),
        violations=count_violations(recording),
        replay_error_m=_summary(replay_error[recording.stable]),
        worst=worst(target, recording, first),
        parameters={name: PARAMETERS[name].meaning for name in target.parameters},
        sensitivity=sensitivity,
    )


def outcome(recording: Trajectories, repeats: bool) -> Outcome:
    """Compute success with Wilson's interval, and the final distances of the stable episodes.

    If all episodes are the same, nothing is random: the rate is exact and its interval has no width.
    """
    successes, episodes = int(recording.success.sum()), recording.episodes
    rate = successes / episodes
    return Outcome(
        episodes=episodes,
        successes=successes,
        success_rate=rate,
        ci95=(rate, rate) if repeats else metrics.wilson_interval(successes, episodes),
        deterministic=repeats,
        unstable=int((~recording.stable).sum()),
        gave_up=int(recording.given_up.sum()),
        final_distance_m=_summary(metrics.final_distance(recording)[recording.stable]),
        final_yaw_deg=_turns(recording),
    )


def _summary(distance: Array) -> Distances:
    """Summarize distances like `metrics.distance_summary`; None without episodes."""
    return Distances(**metrics.distance_summary(distance)) if len(distance) else Distances(mean=None, median=None, p90=None)


def _turns(recording: Trajectories) -> Turns | None:
    """Summarize how far the object was turned in the stable episodes; None without an object or without episodes."""
    turned = metrics.final_yaw(recording)
    if turned is None or not recording.stable.any():
        return None
    either_way = np.abs(turned[recording.stable])
    return Turns(median=float(np.median(either_way)), p90=float(np.quantile(either_way, 0.9)))


def count_violations(recording: Trajectories) -> dict[str, int]:
    """Count the episodes that violate each limit; empty if the task has none."""
    return {limit: int((steps > 0).sum()) for limit, steps in recording.violation_steps.items()}


def worst(target: TargetRobots, recording: Trajectories, first: int) -> tuple[WorstEpisode, ...]:
    """List unstable episodes, then those that end farthest from their target, with the scalar parameters drawn for them."""
    distance = metrics.final_distance(recording)
    single = {name: values for name, values in target.parameters.items() if values.ndim == 1}
    return tuple(
        WorstEpisode(
            episode=first + int(episode),
            final_distance_m=float(distance[episode]) if recording.stable[episode] else None,
            success=bool(recording.success[episode]),
            parameters={name: float(values[episode]) for name, values in single.items()},
        )
        for episode in np.argsort(-np.where(recording.stable, distance, np.inf), kind="stable")[:WORST]
    )


def one_at_a_time(target: TargetRobots) -> dict[str, TargetRobots]:
    """Split the robots into one set per parameter, with every other parameter nominal; by name."""
    found = {}
    for name in target.parameters:
        if name not in MANNERS:
            found[name] = target.only(each for each in (name, *NEEDS.get(name, ())) if each in target.parameters)
    return found


def most_harmful_first(alone: dict[str, tuple[TargetRobots, Trajectories]]) -> tuple[Alone, ...]:
    """Sort the results with one parameter alone: lowest success first, then larger median distance."""
    rows = [Alone(**vars(outcome(recording, target.repeats)), parameter=name) for name, (target, recording) in alone.items()]
    return tuple(sorted(rows, key=lambda row: (row.success_rate, -_far(row.final_distance_m.median))))


def _far(median: float | None) -> float:
    return float("inf") if median is None else median
