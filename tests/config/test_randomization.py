"""Distributions: how they are written, what is refused, and what is drawn from them."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from ranges import log_uniform, one_of, uniform
from worlds import JOINTS

from skillcli.config.randomization import (
    IDENTITY,
    MAX_LATENCY,
    PARAMETERS,
    PER_JOINT,
    Distribution,
    Distributions,
    latin_hypercube,
    sample,
)
from skillcli.errors import UsageError

READER: TypeAdapter[dict[str, Distribution]] = TypeAdapter(Distributions)


def fixed(*values: float) -> Distribution:
    return Distribution(kind="fixed", values=values)


def read(toml: str) -> dict[str, Distribution]:
    """Distributions as a recipe's file writes them."""
    return READER.validate_python(tomllib.loads(toml))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize(
    ("toml", "expected", "told"),
    [
        ("gain = { uniform = [0.6, 1.4] }", uniform(0.6, 1.4), "0.6 .. 1.4"),
        ("gain = { uniform = [1, 1] }", uniform(1, 1), "1 .. 1"),
        ("gain = { log_uniform = [0.5, 2.0] }", log_uniform(0.5, 2), "0.5 .. 2 (log)"),
        ("gain = { one_of = [0.0, 0.05] }", one_of(0, 0.05), "0 or 0.05"),
        ("gain = { one_of = [3] }", one_of(3), "3"),
        ("gain = 0.005", one_of(0.005), "0.005"),
        ("gain = 2", one_of(2), "2"),
        (
            "gain = { values = [1, 2, 3, 4, 5, 6, 7] }",
            Distribution(kind="fixed", values=(1, 2, 3, 4, 5, 6, 7)),
            "1, 2, 3, 4, 5, 6, 7",
        ),
        (
            "gain = { low = [1, 2, 3, 4, 5, 6, 7], high = [1, 3, 4, 5, 6, 7, 8.5] }",
            Distribution(kind="between", values=(1, 2, 3, 4, 5, 6, 7, 1, 3, 4, 5, 6, 7, 8.5)),
            "1 .. 1, 2 .. 3, 3 .. 4, 4 .. 5, 5 .. 6, 6 .. 7, 7 .. 8.5",
        ),
        ("gain = { kind = 'uniform', values = [0.6, 1.4] }", uniform(0.6, 1.4), "0.6 .. 1.4"),
    ],
)
def test_every_way_to_write_a_range_is_read_stored_and_told(toml: str, expected: Distribution, told: str) -> None:
    found = read(toml)
    assert found == {"gain": expected} and str(found["gain"]) == told
    assert READER.validate_python(READER.dump_python(found, mode="json")) == found


@pytest.mark.parametrize(
    ("toml", "said"),
    [
        ("gain = 'wide'", "expected a number, or one of"),
        ("gain = true", "expected a number, or one of"),
        ("gain = [0.6, 1.4]", "expected a number, or one of"),
        ("gain = {}", "expected a number, or one of"),
        ("gain = { normal = [1.0, 0.1] }", "expected a number, or one of"),
        ("gain = { uniform = [0.6, 1.4], one_of = [1] }", "expected a number, or one of"),
        ("gain = { kind = 'normal', values = [1.0, 0.1] }", "kind"),
        ("gain = { uniform = 1.4 }", "tuple"),
        ("gain = { uniform = ['low', 'high'] }", "number"),
        ("gain = { uniform = [1.4, 0.6] }", r"uniform takes \[low, high\] with low <= high, got \[1.4, 0.6\]"),
        ("gain = { uniform = [0.6] }", r"uniform takes \[low, high\]"),
        ("gain = { uniform = [0.6, 1.0, 1.4] }", r"uniform takes \[low, high\]"),
        ("gain = { low = [1, 1], high = [2] }", "two lists of the same length"),
        ("gain = { low = 1, high = 2 }", "two lists of the same length"),
        ("gain = { low = [1, 3], high = [2, 2] }", "every value of low is at most that of high"),
        ("gain = { low = [1, 2] }", "expected a number, or one of"),
        ("table_tilt = { low = [0, 0, 0], high = [0, 0, 0] }", "table_tilt has 2 values in each episode, got 3"),
        ("gain = { log_uniform = [0.0, 1.4] }", "log_uniform needs positive bounds"),
        ("gain = { one_of = [] }", "no values"),
        ("gain = nan", "finite"),
        ("gain = { uniform = [0.6, inf] }", "finite"),
        ("wind = 3.0", "no parameter 'wind'; parameters: link_mass, "),
        ("gain = -0.1", r"gain must lie between 0 and 1000 as a factor, got -0.1"),
        ("link_mass = 0", r"link_mass must lie between 0.01 and 100 as a factor, got 0"),
        ("joint_noise = { one_of = [0.005, -0.005] }", "joint_noise must lie between 0 and 1 rad, got -0.005"),
        ("latency = { uniform = [0.0, 0.16] }", f"latency must lie between 0 and {MAX_LATENCY} s, got 0.16"),
        ("position_offset = { values = [0.1, 0.1] }", "position_offset has 3 values in each episode, got 2"),
        ("gain = { uniform = ['0.5', '1.5'] }", "number"),
        ("gian = 1.5", "no parameter 'gian', did you mean 'gain'"),
        ("joint_drift = 0.01", "joint_drift has no effect without drift_time"),
        ("drift_time = 1.0", "drift_time has no effect without joint_drift or position_drift"),
        ("push_rate = 1.0", "push_rate has no effect without arm_push or object_push"),
        (f"gain = {10**400}", "number"),
    ],
)
def test_what_cannot_be_meant_is_refused(toml: str, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        read(toml)


@pytest.mark.parametrize(
    "name", ["table_height", "table_tilt", "joint_offset", "position_offset", "start_offset", "object_offset"]
)
def test_offsets_may_be_negative(name: str) -> None:
    assert read(f"{name} = {{ uniform = [-0.1, 0.1] }}")[name] == uniform(-0.1, 0.1)


def test_a_range_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        uniform(0, 1).values = (0.0, 2.0)


def test_uniform_draws_fill_the_range_evenly() -> None:
    values = uniform(2.0, 4.0).draw(rng(), (4000,))
    assert np.histogram(values, bins=4, range=(2, 4))[0] == pytest.approx(1000, abs=100)


def test_a_log_uniform_factor_is_as_often_below_as_above_its_middle() -> None:
    values = sample({"joint_damping": log_uniform(0.25, 4.0)}, 2000, rng(), JOINTS)["joint_damping"]
    assert 0.25 <= values.min() < 0.27 and 3.7 < values.max() <= 4
    assert float((values < 1).mean()) == pytest.approx(0.5, abs=0.02)
    assert float((values < 0.5).mean()) == pytest.approx(0.25, abs=0.02)


def test_one_of_draws_each_value_equally_often_and_no_other() -> None:
    values, counts = np.unique(one_of(0.0, 0.05, 0.1).draw(rng(), (3000,)), return_counts=True)
    assert values.tolist() == [0, 0.05, 0.1] and counts == pytest.approx(1000, abs=100)


def test_a_sample_has_one_row_for_each_episode_and_a_column_for_each_joint_or_axis() -> None:
    drawn = sample({"gain": uniform(0.5, 1.5), "object_offset": uniform(-1, 1), "latency": one_of(0.05)}, 5, rng(), JOINTS)
    assert {name: values.shape for name, values in drawn.items()} == {"gain": (5, 7), "object_offset": (5, 2), "latency": (5,)}
    assert len(np.unique(drawn["gain"])) == 35, "every joint of every episode for itself"
    assert sample({}, 5, rng(), JOINTS) == {}


def test_a_sample_depends_on_the_generator_and_not_on_the_order_of_the_ranges() -> None:
    ranges = {"gain": uniform(0.5, 1.5), "contact_friction": uniform(0.5, 1.5)}
    drawn, again, other = (
        sample(ranges, 9, rng(), JOINTS),
        sample(dict(reversed(ranges.items())), 9, rng(), JOINTS),
        sample(ranges, 9, rng(1), JOINTS),
    )
    for name, values in drawn.items():
        np.testing.assert_array_equal(values, again[name])
        assert (values != other[name]).any()


def test_every_parameter_has_a_size_a_unit_a_meaning_and_a_neutral_value() -> None:
    assert IDENTITY.keys() == PARAMETERS.keys()
    for name, parameter in PARAMETERS.items():
        assert parameter.size in (PER_JOINT, 1, 2, 3) and parameter.meaning
        assert parameter.unit in ("factor", "m", "rad", "s", "1/s", "N s", "share")
        assert IDENTITY[name] == (1 if parameter.unit == "factor" else 0)
        assert parameter.low <= IDENTITY[name] <= parameter.high


def test_fixed_values_are_those_of_each_joint_in_every_episode() -> None:
    values = Distribution(kind="fixed", values=(1, 2, 3, 4, 5, 6, 7))
    assert sample({"gain": values}, 2, rng(), JOINTS)["gain"].tolist() == [[1, 2, 3, 4, 5, 6, 7]] * 2
    assert sample({"latency": Distribution(kind="fixed", values=(0.1,))}, 3, rng(), JOINTS)["latency"].tolist() == [0.1] * 3


def test_between_is_a_range_of_its_own_for_each_joint() -> None:
    values = Distribution(kind="between", values=(1, 2, 3, 4, 5, 6, 7, 1, 2.5, 4, 5, 6, 7, 9))
    drawn = sample({"gain": values}, 500, rng(), JOINTS)["gain"]
    np.testing.assert_allclose(drawn.min(axis=0), [1, 2, 3, 4, 5, 6, 7], atol=0.02)
    np.testing.assert_allclose(drawn.max(axis=0), [1, 2.5, 4, 5, 6, 7, 9], atol=0.02)
    filled = latin_hypercube({"gain": values}, 4, rng(), JOINTS)["gain"]
    assert filled[:, 0].tolist() == [1] * 4 and (np.sort(filled[:, 6]) // 0.5).tolist() == [14, 15, 16, 17]
    assert not values.constant and Distribution(kind="between", values=(1, 2, 1, 2)).constant
    with pytest.raises(UsageError, match="gain has 7 values, the arm 6 joints"):
        sample({"gain": values}, 1, rng(), 6)


def test_only_one_value_is_drawn_where_low_is_high() -> None:
    for values in (uniform(0.7, 0.7), log_uniform(0.7, 0.7), one_of(0.7)):
        assert values.draw(rng(), (4,)).tolist() == pytest.approx([0.7] * 4)


def test_a_bad_range_says_so_when_it_is_made_in_code_too() -> None:
    bad: list[tuple[Any, ...]] = [(uniform, 2, 1), (log_uniform, -1, 1), (one_of,)]
    for make, *values in bad:
        with pytest.raises(ValidationError):
            make(*values)


@pytest.mark.parametrize("values", [uniform(-1, 3), log_uniform(0.5, 2), one_of(4.0, 5.0, 6.0)])
def test_filling_takes_one_value_out_of_each_equal_share(values: Distribution) -> None:
    drawn = latin_hypercube({"gain": values}, 6, rng(), JOINTS)["gain"]
    assert drawn.shape == (6, 7)
    edges = values.quantile(np.arange(6) / 6)
    for joint in range(7):
        ordered = np.sort(drawn[:, joint])
        assert (ordered >= edges).all() and (ordered[:-1] <= np.maximum(edges[1:], ordered[:-1].min())).all()
    if values.kind == "one_of":
        assert (np.sort(drawn, axis=0) == np.array([[4.0, 4, 5, 5, 6, 6]]).T).all()
    assert len(np.unique(drawn.argsort(axis=0), axis=1).T) > 1, "joints are filled in orders of their own"


def test_fixed_values_fill_nothing() -> None:
    tilt = Distribution(kind="fixed", values=(0.0, -0.1))
    assert latin_hypercube({"table_tilt": tilt}, 3, rng(), JOINTS)["table_tilt"].tolist() == [[0.0, -0.1]] * 3
    assert latin_hypercube({"latency": fixed(0.05)}, 3, rng(), JOINTS)["latency"].tolist() == [0.05] * 3


def test_quantiles_run_from_the_lowest_to_the_highest_value() -> None:
    share = np.array([0.0, 0.5, 1.0])
    np.testing.assert_allclose(uniform(2, 6).quantile(share), [2, 4, 6])
    np.testing.assert_allclose(log_uniform(0.5, 8).quantile(share), [0.5, 2, 8])
    assert one_of(3.0, 7.0).quantile(np.array([0.0, 0.49, 0.5, 0.99])).tolist() == [3, 3, 7, 7]
