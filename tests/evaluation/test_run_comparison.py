"""Groups of runs and what is said about them; runs are made up."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.errors import UsageError
from skillcli.evaluation.run_comparison import BETTER, TOO_FEW, UNTOLD, WORSE, compare, efficiency
from skillcli.evaluation.run_groups import Curve, Group, Member


def group(label: str, values: list[float], metric: str = "success_rate", first_seed: int = 0) -> Group:
    return Group(label, tuple(Member(first_seed + seed, 0, {metric: value}, "") for seed, value in enumerate(values)))


def test_every_number_says_how_many_runs_it_stands_on() -> None:
    found = compare([group("a", [0.1, 0.2, 0.3, 0.9]), group("b", [0.5, float("nan"), 0.7])])[0]
    assert [(each.label, each.n, each.iqm.value) for each in found.groups] == [("a", 4, 0.25), ("b", 2, 0.6)]
    pair = found.pairs[0]
    assert pair.n == (4, 2) and pair.paired == 0 and pair.probability == pytest.approx(2 / 8)
    alone = compare([group("a", [0.4])])[0]
    assert alone.groups[0].n == 1 and np.isnan(alone.groups[0].iqm.low) and alone.pairs == ()


def test_too_few_runs_are_said_and_how_many_could_tell() -> None:
    pair = compare([group("a", [0.9, 0.91, 0.92]), group("b", [0.1, 0.11, 0.12])])[0].pairs[0]
    assert (pair.verdict, pair.paired, pair.needed, pair.p) == (TOO_FEW, 3, 6, 0.25)
    pair = compare([group("a", [0.9, 0.91, 0.92]), group("b", [0.1, 0.11, 0.12], first_seed=7)])[0].pairs[0]
    assert (pair.verdict, pair.paired, pair.needed, pair.p) == (TOO_FEW, 0, 4, 0.1)


def test_a_difference_is_told_in_the_direction_of_the_metric() -> None:
    high, low = [0.9 + 0.01 * k for k in range(6)], [0.1 + 0.01 * k for k in range(6)]
    for metric, verdict, probability in (("success_rate", BETTER, 1.0), ("compose.final_distance_m", WORSE, 0.0)):
        pair = compare([group("a", high, metric), group("b", low, metric)])[0].pairs[0]
        assert (pair.verdict, pair.probability, pair.paired, pair.p) == (verdict, probability, 6, 2 / 64)
    pair = compare([group("a", high), group("b", [*high[1:], high[0]])])[0].pairs[0]
    assert pair.verdict == UNTOLD and pair.p > 0.9


def test_pairing_tells_a_small_difference_that_seeds_hide() -> None:
    seeds = np.linspace(0.1, 0.8, 8)
    a, b = (seeds + 0.01 + 0.001 * np.arange(8)).tolist(), seeds.tolist()
    assert compare([group("a", a), group("b", b)])[0].pairs[0].verdict == BETTER
    assert compare([group("a", a), group("b", b, first_seed=100)])[0].pairs[0].verdict == UNTOLD


def test_many_comparisons_are_held_to_the_same_share_of_false_alarms() -> None:
    groups = [group(name, [base + 0.01 * k for k in range(6)]) for name, base in (("a", 0.9), ("b", 0.1), ("c", 0.5))]
    pairs = compare(groups)[0].pairs
    assert [(pair.first, pair.second) for pair in pairs] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert {pair.verdict for pair in pairs} == {TOO_FEW} and pairs[0].p == pytest.approx(3 * 2 / 64) and pairs[0].needed == 7


def test_metrics_are_chosen_by_name_the_success_of_training_first() -> None:
    runs = Group("a", (Member(0, 0, {"efficiency": 0.2, "success_rate": 0.5, "transfer-eval.mild.success_rate": 1.0}, ""),))
    assert [found.name for found in compare([runs])] == ["success_rate", "efficiency", "transfer-eval.mild.success_rate"]
    assert [found.name for found in compare([runs], "mild.success_rate")] == ["transfer-eval.mild.success_rate"]
    with pytest.raises(UsageError, match="no run has the metric 'speed'"):
        compare([runs], "speed")


def test_strata_are_compared_each_with_its_own() -> None:
    def two(label: str, shift: float) -> Group:
        members = (Member(seed, s, {"success_rate": 0.4 * s + shift + 0.01 * seed}, "") for s in (0, 1) for seed in range(4))
        return Group(label, tuple(members))

    pair = compare([two("a", 0.1), two("b", 0.0)])[0].pairs[0]
    assert (pair.verdict, pair.paired, pair.probability) == (BETTER, 8, 1.0)


def test_learning_curves_of_unequal_length_count_who_came_so_far() -> None:
    short, long = np.linspace(0, 100, 11), np.linspace(0, 200, 21)
    curves = [Curve(short, short / 100), Curve(long, long / 200), Curve(long, long / 200)]
    found = efficiency("a", curves)
    assert found is not None and found.steps[0] == 0 and found.steps[-1] == 200
    middle = int(np.argmin(abs(found.steps - 100)))
    assert found.n[middle] == 3 and found.iqm[middle] == pytest.approx(2 / 3)
    assert found.n[-1] == 2 and found.iqm[-1] == pytest.approx(1.0)
    assert efficiency("a", []) is None
