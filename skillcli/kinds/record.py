"""Results as frozen dataclasses: one declaration for writing JSON, checking it, and reading it.

A field without a default is required, and null only if its type allows None. `optional` declares the others.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, Self, Union, cast, get_args, get_origin, get_type_hints

Point = tuple[float, float, float]
"""x, y, z in m."""
Interval = tuple[float, float]
"""Low and high end."""


def point(xyz: Iterable[float]) -> Point:
    """Convert any array or list to three numbers."""
    x, y, z = map(float, xyz)
    return x, y, z


def optional(meaning: Any, *, null: bool = False) -> Any:
    """Declare a field that may be missing: an earlier skill did not write it, or there was nothing to write.

    Args:
        meaning: value of a missing field; None is written as a missing field.
        null: whether null is allowed; None is then written as null.
    """
    if isinstance(meaning, dict):
        return dataclasses.field(default_factory=lambda: dict(meaning), metadata={"null": null})
    return dataclasses.field(default=meaning, metadata={"null": null})


def rest() -> Any:
    """Declare a field for all other keys: they are stored, but not read."""
    return dataclasses.field(default_factory=dict, metadata={"rest": True})


class Slot(NamedTuple):
    """One key of a JSON object."""

    attribute: str
    key: str  # the attribute; without a last underscore that avoids a Python keyword
    hint: Any  # type of the value, other than null
    null: bool  # whether null is allowed
    optional: bool


@dataclass(frozen=True, kw_only=True)
class Record:
    """Part of an artifact's results. Further keys are allowed and not read."""

    def json(self) -> dict[str, Any]:
        """Convert to JSON; None is left out where null is not allowed."""
        found = {slot.key: _plain(getattr(self, slot.attribute)) for slot in slots(type(self)) if not self._left_out(slot)}
        more = rest_of(type(self))
        return {**found, **(getattr(self, more) if more else {})}

    def _left_out(self, slot: Slot) -> bool:
        return slot.optional and not slot.null and getattr(self, slot.attribute) is None

    @classmethod
    def read(cls, found: Mapping[str, Any]) -> Self:
        """Read checked JSON; missing fields get their default."""
        own = slots(cls)
        values = {slot.attribute: reader(slot.hint)(found[slot.key]) for slot in own if slot.key in found}
        if more := rest_of(cls):
            keys = {slot.key for slot in own}
            values[more] = {key: item for key, item in found.items() if key not in keys}
        return cls(**values)


@dataclass(frozen=True, kw_only=True)
class Origin(Record):
    """The original of a migrated artifact."""

    id: str
    content_sha256: str
    command: str


@dataclass(frozen=True, kw_only=True)
class Measured(Record):
    """Values that differ between equal runs and are not hashed."""

    migrated_from: Origin | None = optional(None)


def slots(record: type[Record]) -> tuple[Slot, ...]:
    """Return the keys of a record, in order."""
    return _slots(cast(Any, record))


@cache
def _slots(record: Any) -> tuple[Slot, ...]:
    hints = get_type_hints(record)
    fields = [each for each in dataclasses.fields(record) if "rest" not in each.metadata]
    return tuple(_slot(each, hints[each.name]) for each in fields)


def rest_of(record: type[Record]) -> str:
    """Return the field for all other keys, "" if there is none."""
    return next((each.name for each in dataclasses.fields(record) if "rest" in each.metadata), "")


def _slot(each: dataclasses.Field[Any], hint: Any) -> Slot:
    inner, nullable = without_none(hint)
    optional = each.default is not dataclasses.MISSING or each.default_factory is not dataclasses.MISSING
    null = bool(each.metadata["null"]) if optional else nullable
    return Slot(each.name, each.name.removesuffix("_"), inner, null, optional)


def without_none(hint: Any) -> tuple[Any, bool]:
    """Return a type without None, and whether None was part of it."""
    if get_origin(hint) not in (Union, types.UnionType):
        return hint, False
    inner = [each for each in get_args(hint) if each is not types.NoneType]
    if len(inner) != 1 or len(inner) == len(get_args(hint)):
        raise TypeError(f"a record holds X or X | None, not {hint}")
    return inner[0], True


def is_record(hint: Any) -> bool:
    """Return whether a type is a record."""
    return isinstance(hint, type) and issubclass(hint, Record)


@cache
def reader(hint: Any) -> Callable[[Any], Any]:
    """Return a function from JSON to a value of a type: lists become tuples, objects records."""
    inner, _ = without_none(hint)
    if is_record(inner):
        read: Callable[[Any], Any] = inner.read
    elif get_origin(inner) is tuple:
        each = reader(get_args(inner)[0])
        read = lambda found: tuple(map(each, found))  # noqa: E731
    elif get_origin(inner) is Mapping:
        each = reader(get_args(inner)[1])
        read = lambda found: {key: each(item) for key, item in found.items()}  # noqa: E731
    else:
        return lambda found: found
    return lambda found: None if found is None else read(found)


def _plain(value: Any) -> Any:
    if isinstance(value, Record):
        return value.json()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value
