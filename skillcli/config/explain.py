"""Explain errors of recipes, domains and robot files: what was expected, and what was got."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from skillcli.config.base import Section

_LONGEST = 60  # characters of a value to show
_COUNTED = {1: "one", 2: "two", 3: "three", 4: "four", 7: "seven"}
# Names of pydantic's errors, and what was expected.
_EXPECTED = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of at most 4300 digits",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "some text",
    "tuple_type": "a list",
    "dict_type": "a table of keys",
    "model_type": "a table of keys",
    "model_attributes_type": "a table of keys",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "literal_error": "{expected}",
    "union_tag_invalid": "one of {expected_tags}",
    "string_too_long": "at most {max_length} characters",
}


@dataclass(frozen=True)
class Complaint:
    """The first error of a configuration.

    Attributes:
        keys: from the outermost to the invalid one; empty if the whole is invalid.
        entry: of a list, or of a list within a list, as ", entry 2"; else empty.
        said: what was expected and what was got, or which rule is violated.
        kind: whether a key is unknown or missing, or a value is invalid.
        known: existing keys, if one is unknown.
    """

    keys: tuple[str, ...]
    said: str
    kind: Literal["unknown", "missing", "value"] = "value"
    known: tuple[str, ...] = ()
    entry: str = ""

    @property
    def key(self) -> str:
        """Return the keys as in --set."""
        return ".".join(self.keys)


def complaint(error: ValidationError, root: type[BaseModel]) -> Complaint:
    """Return the first error of a validation of `root`."""
    first = error.errors(include_url=False)[0]
    kind, context, where = first["type"], first.get("ctx", {}), _walk(root, first["loc"])
    if kind == "look_alike":  # found in the section, before its values are validated
        return Complaint((*where.keys, context["key"]), f"{first['msg']}, got {shown(context['got'])}")
    if kind == "extra_forbidden":
        return Complaint(where.keys, "unknown", "unknown", where.siblings)
    if kind == "union_tag_not_found":
        return Complaint((*where.keys, context["discriminator"].strip("'")), "missing", "missing")
    if kind == "union_tag_invalid":
        return Complaint((*where.keys, context["discriminator"].strip("'")), _said(first, None, context["tag"]))
    if kind == "missing" and not where.entries:
        return Complaint(where.keys, "missing", "missing")
    if kind == "missing":  # a missing entry: the list is too short
        return Complaint(where.keys, _said(first, where.holder, first["input"]), entry=_entries(where.entries[:-1]))
    return Complaint(where.keys, _said(first, where.annotation, first.get("input")), entry=_entries(where.entries))


def shown(given: Any) -> str:
    """Write a value as in a TOML file, or describe it if it is long."""
    if isinstance(given, bool):
        return str(given).lower()
    if isinstance(given, Mapping):
        return "a table of keys"
    if isinstance(given, list | tuple):
        return "a list"
    text = repr(given) if isinstance(given, str | int | float) else str(given)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


@dataclass(frozen=True)
class _Where:
    keys: tuple[str, ...]
    entries: tuple[int, ...]  # indices in nested lists, counted from 1
    annotation: Any  # expected type
    holder: Any  # type that contains it
    siblings: tuple[str, ...]


def _walk(root: type[BaseModel], location: Sequence[str | int]) -> _Where:
    """Locate an error in what the user wrote: without names of alternatives, and without the inside of ranges."""
    keys: list[str] = []
    entries: list[int] = []
    annotation: Any = root
    holder: Any = root
    siblings: tuple[str, ...] = ()
    for part in location:
        if isinstance(part, int):
            entries.append(part + 1)
            holder, annotation = annotation, _entry(annotation, part)
            continue
        if option := _alternative(annotation, part):
            annotation = option
            continue
        model = _model(annotation)
        if keys and model is not None and not issubclass(model, Section):
            return _Where(tuple(keys), (), None, None, ())  # a range is one value, however it is written
        fields = model.model_fields if model else {}
        siblings = tuple(fields)
        holder, annotation = annotation, fields[part].annotation if part in fields else _entry(annotation, 1)
        keys.append(part)
    return _Where(tuple(keys), tuple(entries), annotation, holder, siblings)


def _plain(annotation: Any) -> Any:
    """Remove bounds and None from a type."""
    while hasattr(annotation, "__metadata__"):
        annotation = annotation.__origin__
    if get_origin(annotation) in (Union, types.UnionType):
        options = [option for option in get_args(annotation) if option is not type(None)]
        return _plain(options[0]) if len(options) == 1 else annotation
    return annotation


def _alternative(annotation: Any, name: str) -> type[BaseModel] | None:
    """Return the section of this name among several."""
    plain = _plain(annotation)
    options = get_args(plain) if get_origin(plain) in (Union, types.UnionType) else ()
    named = (option for option in options if hasattr(option, "model_fields"))
    return next((option for option in named if option.model_fields["name"].default == name), None)


def _model(annotation: Any) -> type[BaseModel] | None:
    plain = _plain(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def _entry(annotation: Any, index: int) -> Any:
    """Return the expected type of an entry of a list, or of a value of a table."""
    options = [option for option in get_args(_plain(annotation)) if option is not Ellipsis]
    return options[min(index, len(options) - 1)] if options else None


def _entries(entries: Sequence[int]) -> str:
    return f", entry {' of entry '.join(map(str, reversed(entries)))}" if entries else ""


def _said(first: Any, annotation: Any, given: Any) -> str:
    """Say what was expected, and what was got."""
    kind, context = first["type"], first.get("ctx", {})
    if kind == "value_error":
        said = str(context["error"])
        return said if isinstance(given, Mapping | list | tuple) or ", got " in said else f"{said}, got {shown(given)}"
    if kind in ("missing", "too_long", "too_short"):
        return f"expected {_list_of(annotation, context)}, got {_number(given, context)}"
    bounds = {name: f"{bound:g}" if isinstance(bound, float) else bound for name, bound in context.items()}
    expected = _EXPECTED[kind].format(**bounds) if kind in _EXPECTED else "something else"
    return f"expected {expected}, got {shown(given)}"


def _number(given: Any, context: Mapping[str, Any]) -> str:
    count = context.get("actual_length", len(given) if isinstance(given, list | tuple) else 0)
    return str(count or "none")


def _list_of(annotation: Any, context: Mapping[str, Any]) -> str:
    """Say how many entries of which type a list needs."""
    options = [option for option in get_args(_plain(annotation)) if option is not Ellipsis]
    fixed = Ellipsis not in get_args(_plain(annotation)) and len(options)
    count = fixed or context.get("min_length") or context.get("max_length") or 1
    what = "number" if options and _plain(options[0]) in (int, float) else "entry"
    plural = {"number": "numbers", "entry": "entries"}[what] if count != 1 else what
    bound = "" if fixed else "at least " if "min_length" in context or "max_length" not in context else "at most "
    return f"{bound}{_COUNTED.get(count, count)} {plural}"
