"""Recipe sections: frozen, bounded, and nothing that only looks like a number or like true and false."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from skillcli.config.base import Section, value

SIZES = "0, or a number between 1e-12 and 1e+12 or its negative"


class Sample(Section):
    number: float = value(1.5, "any number from 0 on", "m", ge=0)
    count: int | None = value(None, "a whole number, or none")
    flag: bool = value(False, "true or false")
    pairs: tuple[tuple[float, float], ...] = value((), "two numbers each")
    text: str = value("", "a word")


@pytest.mark.parametrize(
    ("given", "expected", "got"),
    [
        ({"number": "1"}, "a number", "1"),
        ({"number": True}, "a number", True),
        ({"count": True}, "a whole number", True),
        ({"count": "2"}, "a whole number", "2"),
        ({"flag": 1}, "true or false", 1),
        ({"flag": "yes"}, "true or false", "yes"),
        ({"pairs": [[1, 2], [3, "4"]]}, "a number", "4"),
        ({"number": 1e300}, SIZES, 1e300),
        ({"number": 10**400}, SIZES, 10**400),
        ({"number": 1e-300}, SIZES, 1e-300),
        ({"pairs": [[0, -1e13]]}, SIZES, -1e13),
    ],
)
def test_what_only_looks_like_a_value_is_refused(given: dict[str, Any], expected: str, got: Any) -> None:
    with pytest.raises(ValidationError) as caught:
        Sample(**given)
    (error,) = caught.value.errors()
    assert error["type"] == "look_alike" and error["ctx"] == {"key": next(iter(given)), "expected": expected, "got": got}


def test_values_that_are_meant_are_taken() -> None:
    found = Sample(number=2, count=3, flag=True, pairs=((1, 2.5),), text="1")
    assert (found.number, found.count, found.flag, found.pairs, found.text) == (2.0, 3, True, ((1.0, 2.5),), "1")
    assert Sample(count=None).count is None
    assert Sample(count=10**30, number=0, pairs=((-1e12, 1e-12),)).count == 10**30


@pytest.mark.parametrize("given", [{"numbr": 1.0}, {"number": -0.1}, {"number": float("nan")}, {"number": float("inf")}])
def test_unknown_keys_bounds_and_numbers_that_are_not_finite_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Sample(**given)


def test_a_section_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Sample().number = 3.0  # type: ignore[misc]


def test_a_field_knows_its_unit_and_its_meaning() -> None:
    field = Sample.model_fields["number"]
    assert field.description == "any number from 0 on" and field.json_schema_extra == {"unit": "m"}
