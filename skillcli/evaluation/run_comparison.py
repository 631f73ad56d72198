"""Compare groups of runs, metric by metric: how well each does, and which are better than which others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillcli.errors import UsageError
from skillcli.evaluation import statistics
from skillcli.evaluation.run_groups import Curve, Group, curves_of
from skillcli.evaluation.run_metrics import FIRST, higher_is_better
from skillcli.evaluation.statistics import LEVEL, Estimate
from skillcli.store import Store
from skillcli.trajectories import Array

POINTS = 41  # of a profile, and of a learning curve
MOST_GROUPS = 64  # whose pairs are all compared

BETTER, WORSE, UNTOLD, TOO_FEW = "better", "worse", "no difference told", "too few runs to tell"


@dataclass(frozen=True, eq=False)
class GroupResult:
    """How well a group does."""

    label: str
    n: int
    iqm: Estimate
    mean: float
    profile: tuple[Array, Array, Array]  # share of runs above each threshold (T,), and both ends of its band

    @property
    def interval(self) -> str:
        """Return the 95 % interval as people read it; one run has none."""
        return f"{self.iqm.low:.4g} – {self.iqm.high:.4g}" if self.n > 1 else "one run"


@dataclass(frozen=True)
class PairResult:
    """Whether the first of two groups is better than the second."""

    first: str
    second: str
    n: tuple[int, int]
    paired: int  # runs with the same seed that were compared; 0: all with all
    probability: float  # that a run of the first is better than one of the second
    ci95: tuple[float, float]
    p: float  # adjusted for the number of pairs
    verdict: str
    needed: int  # runs of each that could tell a difference


@dataclass(frozen=True, eq=False)
class MetricResult:
    """One metric of all groups."""

    name: str
    higher_is_better: bool
    groups: tuple[GroupResult, ...]
    pairs: tuple[PairResult, ...]
    thresholds: Array  # (T,) of the profiles


@dataclass(frozen=True, eq=False)
class Efficiency:
    """How a group learns: the interquartile mean of the success after so many control steps."""

    label: str
    steps: Array  # (T,)
    iqm: Array  # (T,)
    low: Array
    high: Array
    n: Array  # (T,) runs that were trained as long


def compare(groups: Sequence[Group], metric: str = "") -> list[MetricResult]:
    """Compare groups by one metric, or by every one that they have; the success of training comes first.

    Raises:
        UsageError: no group has such a metric, or there are too many groups.
    """
    if len(groups) > MOST_GROUPS:
        raise UsageError(f"{len(groups)} groups, at most {MOST_GROUPS} are compared with each other", "compare fewer settings")
    known = list(dict.fromkeys(name for group in groups for name in group.metrics))
    chosen = [name for name in known if metric in ("", name)] or [name for name in known if name.endswith(f".{metric}")]
    if not chosen:
        if not known:
            raise UsageError("no run is finished", "`skill show ID` of the sweep says why each one failed")
        raise UsageError(f"no run has the metric {metric!r}", f"metrics: {', '.join(known)}")
    chosen.sort(key=lambda name: name != FIRST)
    return [found for name in chosen if (found := _of_metric(groups, name)).groups]


def _of_metric(groups: Sequence[Group], name: str) -> MetricResult:
    values = [(group.label, strata) for group in groups if (strata := group.strata(name))]
    whole = [np.array([value for each in strata.values() for value in each.values()]) for _, strata in values]
    low, high = (min(map(np.min, whole)), max(map(np.max, whole))) if whole else (0.0, 0.0)
    thresholds = np.linspace(low, high, POINTS)
    found = []
    for label, strata in values:
        scores = [np.array(list(each.values())) for each in strata.values()]
        profile = statistics.profile(scores, thresholds)
        count, mean = sum(map(len, scores)), float(np.concatenate(scores).mean())
        found.append(GroupResult(label, count, statistics.estimate(scores), mean, profile))
    return MetricResult(name, higher_is_better(name), tuple(found), _pairs(values, higher_is_better(name)), thresholds)


Values = tuple[str, dict[int, dict[int, float]]]


def _pairs(values: Sequence[Values], higher: bool) -> tuple[PairResult, ...]:
    """Compare every group with every later one; the p values are adjusted for all of these comparisons."""
    every = [(a, b) for index, a in enumerate(values) for b in values[index + 1 :]]
    tests = [_test(a[1], b[1]) for a, b in every]
    adjusted = statistics.holm(tests)
    return tuple(_pair(a, b, test, p, higher, len(every)) for (a, b), test, p in zip(every, tests, adjusted, strict=True))


def _test(a: dict[int, dict[int, float]], b: dict[int, dict[int, float]]) -> statistics.PermutationTest:
    """Compare runs with the same seed where both groups have the same seeds, all with all elsewhere."""
    shared = sorted(a.keys() & b.keys())
    if shared and all(a[each].keys() == b[each].keys() for each in shared) and a.keys() == b.keys():
        return statistics.paired_test(np.array([a[s][seed] - b[s][seed] for s in shared for seed in sorted(a[s])]))
    if not shared:
        return statistics.PermutationTest(1.0, 1.0, 0)
    return statistics.unpaired_test(*_arrays(a, b, shared))


def _arrays(
    a: dict[int, dict[int, float]], b: dict[int, dict[int, float]], shared: Sequence[int]
) -> tuple[list[Array], list[Array]]:
    first, second = ([np.array(list(each[stratum].values())) for stratum in shared] for each in (a, b))
    return first, second


def _pair(a: Values, b: Values, test: statistics.PermutationTest, p: float, higher: bool, comparisons: int) -> PairResult:
    shared = sorted(a[1].keys() & b[1].keys())
    first, second = _arrays(a[1], b[1], shared)
    if not higher:
        first, second = [-each for each in first], [-each for each in second]
    enough = test.smallest * comparisons <= LEVEL
    probability = statistics.improvement(first, second) if shared else float("nan")
    interval = statistics.improvement_interval(first, second) if shared else (float("nan"), float("nan"))
    apart = np.mean([x.mean() - y.mean() for x, y in zip(first, second, strict=True)]) if shared else 0.0
    verdict = TOO_FEW if not enough else UNTOLD if p > LEVEL else BETTER if apart > 0 else WORSE
    counts = tuple(sum(len(each) for each in group[1].values()) for group in (a, b))
    needed = _needed(bool(test.pairs), comparisons)
    return PairResult(a[0], b[0], (counts[0], counts[1]), test.pairs, probability, interval, p, verdict, needed)


def _needed(paired: bool, comparisons: int) -> int:
    """Return the fewest runs of each group with which any difference could be told."""
    from math import comb

    return next(n for n in range(1, 64) if comparisons * 2 / (2**n if paired else comb(2 * n, n)) <= LEVEL)


def sentence(pair: PairResult) -> str:
    """Say whether the first of two groups is better, and from how many runs."""
    low, high = pair.ci95
    runs = f"{pair.paired} pairs of one seed" if pair.paired else f"n = {pair.n[0]} and {pair.n[1]}"
    more = f": {pair.needed} of each could tell" if pair.verdict == TOO_FEW else f", p = {pair.p:.2g}"
    verdict = f"{pair.verdict} than" if pair.verdict in (BETTER, WORSE) else "against"
    tail = "" if pair.verdict in (BETTER, WORSE) else f": {pair.verdict}"
    return (
        f"{pair.first} {verdict} {pair.second}{tail}{more}; better with probability {pair.probability:.2f} "
        f"({low:.2f}–{high:.2f}), {runs}"
    )


def learning_of(store: Store, groups: Sequence[Group]) -> list[Efficiency]:
    """Summarise how each group learned, without groups that have no learning curves."""
    return [found for group in groups if (found := efficiency(group.label, curves_of(store, group)))]


def efficiency(label: str, curves: Sequence[Curve]) -> Efficiency | None:
    """Summarise learning curves, which may have different lengths; each point counts the runs that came so far.

    None without curves.
    """
    if not curves:
        return None
    first, last = min(float(each.steps[0]) for each in curves), max(float(each.steps[-1]) for each in curves)
    steps = np.linspace(first, last, POINTS)
    rows = np.stack([np.interp(steps, each.steps, each.success, left=np.nan, right=np.nan) for each in curves])
    points = [column[np.isfinite(column)] for column in rows.T if np.isfinite(column).any()]
    found = [statistics.estimate([point], resamples=statistics.QUICK_RESAMPLES) for point in points]
    kept = np.isfinite(rows).any(axis=0)
    return Efficiency(
        label,
        steps[kept],
        np.array([each.value for each in found]),
        np.array([each.low for each in found]),
        np.array([each.high for each in found]),
        np.isfinite(rows).sum(axis=0)[kept],
    )
