"""The basis of recipe sections: frozen, bounded, described values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

Vector3 = tuple[float, float, float]
Joints = tuple[float, ...]  # one number for each joint of the arm
SMALLEST, LARGEST = 1e-12, 1e12
"""Bounds of any number but zero: beyond them, products and single precision give zero, infinity or NaN."""


def value(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    """Declare a recipe field: its default, description, unit and bounds."""
    return Field(default=default, description=description, json_schema_extra={"unit": unit}, **bounds)


def optional_value(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    """Declare a recipe field that is stored only if it differs from its default, so that older stored recipes stay the same."""
    return value(default, description, unit, exclude_if=lambda given: given == default, **bounds)


class Section(BaseModel):
    """A frozen section.

    It refuses unknown keys, NaN, infinities and absurdly large or small numbers, and texts in place of numbers or booleans.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _no_look_alikes(cls, given: Any) -> Any:
        """Refuse true and "1" for the number 1, and 1 and "yes" for true: pydantic would accept them."""
        for key, item in given.items() if isinstance(given, Mapping) else ():
            if key in cls.model_fields:
                wanted = set(_leaves(cls.model_fields[key].annotation))
                _check_look_alikes(key, item, wanted)
                _check_size(key, item, wanted)
        return given


def _check_look_alikes(key: str, given: Any, wanted: set[Any]) -> None:
    for item in _leaves_of(given):
        if wanted <= {int, float} and isinstance(item, bool | str):
            raise _look_alike(key, "a number" if float in wanted else "a whole number", item)
        if wanted == {bool} and not isinstance(item, bool):
            raise _look_alike(key, "true or false", item)


def _check_size(key: str, given: Any, wanted: set[Any]) -> None:
    for item in _leaves_of(given) if float in wanted else ():
        if isinstance(item, int | float) and (0 < abs(item) < SMALLEST or LARGEST < abs(item) < math.inf):
            raise _look_alike(key, f"0, or a number between {SMALLEST:g} and {LARGEST:g} or its negative", item)


def _leaves(annotation: Any) -> Iterator[Any]:
    """Yield the types that a value, or the entries of a list, may have."""
    inner = [option for option in get_args(annotation) if option is not Ellipsis and option is not type(None)]
    if not inner:
        yield annotation
    for option in inner:
        yield from _leaves(option)


def _leaves_of(given: Any) -> Iterator[Any]:
    if not isinstance(given, list | tuple):
        yield given
        return
    for item in given:
        yield from _leaves_of(item)


def _look_alike(key: str, expected: str, item: Any) -> PydanticCustomError:
    return PydanticCustomError("look_alike", "expected {expected}", {"key": key, "expected": expected, "got": item})
