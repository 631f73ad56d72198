"""Statistics of a few runs: interquartile means with bootstrap intervals, profiles, and whether two groups differ.

The measures are those of Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice (2021). Scores
come in strata, such as the settings that two methods share: every resample keeps the number of runs of each stratum. Whether
two groups differ is decided by a permutation test, whose share of false alarms is at most its level for any number of runs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from skillcli.seeding import generator
from skillcli.trajectories import Array

Strata = Sequence[Array]
"""Scores of the runs of each stratum, (n_s,)."""

RESAMPLES = 50_000  # then another seed moves the ends of an interval by about a hundredth of its width
QUICK_RESAMPLES = 5_000  # of each point of a curve
_BAND_RESAMPLES = 1_000  # of a profile, and of a probability of improvement
_BLOCK = 1 << 21  # scores that are drawn at once
LEVEL = 0.05  # of false alarms
EXACT = 20_000  # permutations up to which all of them are tried


def iqm(scores: Array, axis: int = -1) -> Array:
    """Compute the interquartile mean: the mean without the lowest and the highest quarter, (…, n) to (…).

    As in the paper, a quarter of n is rounded down: of fewer than four scores it is the mean.
    """
    ordered = np.sort(scores, axis=axis)
    count = ordered.shape[axis]
    cut = count // 4
    mean: Array = np.take(ordered, np.arange(cut, count - cut), axis=axis).mean(axis=axis)
    return mean


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, which is NaN of a single run."""

    value: float
    low: float
    high: float


def resampled(strata: Strata, count: int, rng: np.random.Generator) -> Array:
    """Draw runs with replacement within each stratum, `count` times; (count, n) scores."""
    return np.concatenate([each[rng.integers(len(each), size=(count, len(each)))] for each in strata], axis=1)


def estimate(strata: Strata, statistic: Callable[[Array], Array] = iqm, seed: int = 0, resamples: int = RESAMPLES) -> Estimate:
    """Estimate a statistic of all runs, with the percentile interval of a stratified bootstrap.

    Args:
        strata: scores.
        statistic: (…, n) to (…).
        seed: of the resamples.
        resamples: how many.
    """
    value, runs = float(statistic(np.concatenate(list(strata)))), sum(map(len, strata))
    if runs < 2:
        return Estimate(value, math.nan, math.nan)
    rng, block = generator(seed, "bootstrap"), max(1, _BLOCK // runs)
    counts = (min(block, resamples - done) for done in range(0, resamples, block))
    draws = np.concatenate([statistic(resampled(strata, count, rng)) for count in counts])
    low, high = np.quantile(draws, [LEVEL / 2, 1 - LEVEL / 2])
    return Estimate(value, float(low), float(high))


def profile(strata: Strata, thresholds: Array, seed: int = 0) -> tuple[Array, Array, Array]:
    """Compute the share of runs above each threshold τ (T,): the performance profile, and both ends of its band."""
    scores = np.concatenate(list(strata))
    share: Array = (scores[:, None] > thresholds).mean(axis=0)
    draws = resampled(strata, _BAND_RESAMPLES, generator(seed, "profile"))
    shares = (draws[:, :, None] > thresholds).mean(axis=1)
    low, high = np.quantile(shares, [LEVEL / 2, 1 - LEVEL / 2], axis=0)
    return share, low, high


def improvement(first: Strata, second: Strata) -> float:
    """Compute the probability that a run of the first group scores higher than one of the second, ties as a half.

    The mean over strata of the Mann-Whitney U statistic, divided by the number of pairs.
    """
    return float(np.mean([_above(a, b) for a, b in zip(first, second, strict=True)]))


def improvement_interval(first: Strata, second: Strata, seed: int = 0) -> tuple[float, float]:
    """Compute the 95 % bootstrap interval of `improvement`, with runs drawn anew in both groups."""
    rng = generator(seed, "improvement")
    draws = np.zeros(_BAND_RESAMPLES)
    for a, b in zip(first, second, strict=True):
        chosen_a, chosen_b = (each[rng.integers(len(each), size=(len(draws), len(each)))] for each in (a, b))
        draws += _above(chosen_a, chosen_b) / len(first)
    low, high = np.quantile(draws, [LEVEL / 2, 1 - LEVEL / 2])
    return float(low), float(high)


def _above(a: Array, b: Array) -> Array:
    """Compare all pairs, (…, n) and (…, m) to (…)."""
    apart = a[..., :, None] - b[..., None, :]
    share: Array = ((apart > 0) + 0.5 * (apart == 0)).mean(axis=(-2, -1))
    return share


@dataclass(frozen=True)
class PermutationTest:
    """A permutation test of two groups.

    Attributes:
        p: how often a difference at least as large would come by chance.
        smallest: the smallest p that so few runs can give.
        pairs: of runs that were compared with each other; 0 where runs are not paired.
    """

    p: float
    smallest: float
    pairs: int


def paired_test(differences: Array, seed: int = 0) -> PermutationTest:
    """Test whether differences of pairs (n,) are centred on zero: the sign of each could as well be the other one."""
    count = len(differences)
    if not count:
        return PermutationTest(1.0, 1.0, 0)
    if 2**count <= EXACT:
        signs = _signs(count)
        return PermutationTest(_share(np.abs((signs * differences).mean(axis=1)), 0), 2.0 / 2**count, count)
    signs = generator(seed, "signs").choice([1.0, -1.0], size=(EXACT // 2 - 1, count))
    drawn = np.abs((np.concatenate([np.ones((1, count)), signs]) * differences).mean(axis=1))
    return PermutationTest(_share(drawn, 0), 1.0 / len(drawn), count)


def unpaired_test(first: Strata, second: Strata, seed: int = 0) -> PermutationTest:
    """Test whether two groups come from the same distribution: within a stratum, runs could as well be of the other group.

    The statistic is the difference of the means, averaged over strata.
    """
    ways = math.prod(math.comb(len(a) + len(b), len(a)) for a, b in zip(first, second, strict=True))
    if len(first) == 1 and ways <= EXACT:
        drawn = _every_split(first[0], second[0])
    else:
        rng = generator(seed, "permutations")
        drawn = np.mean([_random_splits(a, b, EXACT // 2 - 1, rng) for a, b in zip(first, second, strict=True)], axis=0)
    smallest = max(1.0 / len(drawn), (2.0 if all(len(a) == len(b) for a, b in zip(first, second, strict=True)) else 1.0) / ways)
    return PermutationTest(_share(np.abs(drawn), 0), smallest, 0)


def _every_split(a: Array, b: Array) -> Array:
    """Return the difference of the means for every way to split the runs; the given one is the first."""
    scores, count = np.concatenate([a, b]), len(a)
    total, part = scores.sum(), scores[_splits(len(scores), count)].sum(axis=1)
    apart: Array = part / count - (total - part) / len(b)
    return apart


@cache
def _signs(count: int) -> Array:
    """List every combination of signs, all positive first."""
    return np.array(list(itertools.product((1.0, -1.0), repeat=count)))


@cache
def _splits(total: int, count: int) -> Array:
    """List every choice of `count` among `total`, the first ones first."""
    return np.array(list(itertools.combinations(range(total), count)))


def _random_splits(a: Array, b: Array, count: int, rng: np.random.Generator) -> Array:
    scores = np.tile(np.concatenate([a, b]), (count + 1, 1))
    scores[1:] = rng.permuted(scores[1:], axis=1)
    apart: Array = scores[:, : len(a)].mean(axis=1) - scores[:, len(a) :].mean(axis=1)
    return apart


def _share(drawn: Array, given: int) -> float:
    """Return the share of drawn statistics that are at least as large as the given one, itself among them."""
    scale = max(1e-300, float(np.abs(drawn).max()))
    return float((drawn >= drawn[given] - 1e-9 * scale).mean())


def holm(tests: Sequence[PermutationTest]) -> list[float]:
    """Adjust p values of several comparisons, so that a false alarm among all of them stays as rare (Holm 1979)."""
    order = sorted(range(len(tests)), key=lambda index: tests[index].p)
    adjusted, largest = [1.0] * len(tests), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(tests) - rank) * tests[index].p))
        adjusted[index] = largest
    return adjusted
