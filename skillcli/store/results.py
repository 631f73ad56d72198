"""Check results against their kind: the keys, with types, that tables, figures and later stages read.

Further keys are allowed. Keys that an earlier skill did not write are optional, or added by migration.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast, get_args, get_origin

from skillcli.kinds import kind_spec
from skillcli.kinds.record import Record, Slot, is_record, slots, without_none
from skillcli.kinds.spec import LARGEST

Form = Any
"""A type (int, float, bool, str), a mapping from keys to forms, `ListOf`, `DictOf`, or `Maybe` one of these."""


@dataclass(frozen=True)
class ListOf:
    """A list."""

    of: Form
    count: int = 0  # exact length; 0 for any


@dataclass(frozen=True)
class DictOf:
    """An object with any keys."""

    of: Form


@dataclass(frozen=True)
class Maybe:
    """A form, or null."""

    form: Form


@dataclass(frozen=True)
class Optional:
    """A key that may be missing, because an earlier skill did not write it."""

    form: Form


def complaints(kind: str, results: Mapping[str, Any], measured: Mapping[str, Any]) -> Iterator[str]:
    """List where results and measurements disagree with their kind, one line each."""
    spec = kind_spec(kind)
    yield from _against(_form(spec.results), results, "results")
    yield from _against(_form(spec.measured), measured, "measured")


def _form(record: type[Record]) -> Mapping[str, Form]:
    return _cached_form(cast(Any, record))


@cache
def _cached_form(record: Any) -> Mapping[str, Form]:
    return {slot.key: _slot_form(slot) for slot in slots(record)}


def _slot_form(slot: Slot) -> Form:
    form = _form_of(slot.hint)
    form = Maybe(form) if slot.null else form
    return Optional(form) if slot.optional else form


def _form_of(hint: Any) -> Form:
    inner, null = without_none(hint)
    return Maybe(_form_of(inner)) if null else _bare_form(inner)


def _bare_form(hint: Any) -> Form:
    if is_record(hint):
        return _form(hint)
    if get_origin(hint) is tuple:
        each, *more = get_args(hint)
        return ListOf(_form_of(each), 0 if more == [...] else 1 + len(more))
    if get_origin(hint) is Mapping:
        return DictOf(_form_of(get_args(hint)[1]))
    if hint not in _SAID:
        raise TypeError(f"no results can hold {hint}")
    return hint


def _against(form: Form, found: Any, where: str) -> Iterator[str]:
    if isinstance(form, Maybe):
        if found is not None:
            yield from _against(form.form, found, where)
    elif isinstance(form, type):
        if not _is(form, found):
            yield f"{where} must be {_SAID[form]}, got {_shown(found)}"
    elif isinstance(form, ListOf):
        yield from _entries(form, found, where)
    elif not isinstance(found, dict):
        yield f"{where} must be an object, got {_shown(found)}"
    elif isinstance(form, DictOf):
        for key, item in found.items():
            yield from _against(form.of, item, f"{where}.{key[:40]!r}")
    else:
        yield from _keys(form, found, where)


def _entries(form: ListOf, found: Any, where: str) -> Iterator[str]:
    if not isinstance(found, list):
        yield f"{where} must be a list, got {_shown(found)}"
    elif form.count and len(found) != form.count:
        yield f"{where} must have {form.count} entries, got {len(found)}"
    else:
        for index, item in enumerate(found):
            yield from _against(form.of, item, f"{where}[{index}]")


def _keys(form: Mapping[str, Form], found: Mapping[str, Any], where: str) -> Iterator[str]:
    for key, wanted in form.items():
        if key in found:
            yield from _against(wanted.form if isinstance(wanted, Optional) else wanted, found[key], f"{where}.{key}")
        elif not isinstance(wanted, Optional):
            yield f"{where}.{key} is missing"


def _is(form: type, found: Any) -> bool:
    if isinstance(found, bool) or form in (str, bool):
        return form is type(found)
    return isinstance(found, int if form is int else int | float) and abs(found) <= LARGEST


_SAID = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


def _shown(found: Any) -> str:
    return f"{type(found).__name__} {str(found)[:20]!r}" if isinstance(found, str | int | float) else type(found).__name__
