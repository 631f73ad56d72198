"""JSON from elsewhere: strict, bounded, and each key once."""

from __future__ import annotations

import time
from contextlib import suppress

import pytest

from skillcli.store.canonical_json import MAX_DEPTH, canonical, parse


def nested(depth: int, inside: str = "") -> str:
    return "[" * depth + inside + "]" * depth


@pytest.mark.parametrize(
    "value", [None, True, 1.5, "a", [1, [2]], {"a": {"b": [{}]}}, 2**127, -(2**127), ["[" * 100, '"]{"', "\\", 'x\\"']]
)
def test_what_is_written_is_read(value: object) -> None:
    assert parse(canonical(value)) == value == parse(canonical(value).encode())


def test_as_deep_as_is_allowed_is_read() -> None:
    deepest = nested(MAX_DEPTH, '"' + "[" * 99 + '"')
    assert canonical(parse(deepest)) == deepest
    assert len(parse(f"[{','.join(['{}'] * 1000)}]")) == 1000, "many beside each other are not deep"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (nested(MAX_DEPTH + 1), "nested more than 32 deep"),
        (nested(930), "nested more than 32 deep"),
        ("[" * 500_000, "nested more than 32 deep"),
        ('{"a":' * 33 + "1" + "}" * 33, "nested more than 32 deep"),
        ('["' + "\\\\" * 9 + '",' + nested(33) + "]", "nested more than 32 deep"),
        ('{"a":1,"b":2,"a":1}', "'a' more than once"),
        ('[{"x":{"a":1,"a":2}}]', "'a' more than once"),
        ("NaN", "NaN is not JSON"),
        ("[-Infinity]", "-Infinity is not JSON"),
        ("1e999", "1e999 is not a finite number"),
        ("9" * 400, "an integer of 400 digits"),
        ("{", "Expecting"),
        (b"\xff", "decode"),
    ],
)
def test_what_the_store_never_writes_is_refused(text: str | bytes, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        parse(text)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 33 + '"' + '\\"' * 500_000,
        "[" * 33 + '"' * 900_001,
        "[" + "[]," * 330_000 + "0]",
        "{" + ",".join(f'"{number}":1' for number in range(90_000)) + ',"89999":2}',
    ],
    ids=["escapes", "quotes", "wide", "keys"],
)
@pytest.mark.slow
def test_a_megabyte_made_to_be_slow_takes_a_moment(text: str) -> None:
    started = time.process_time()
    with suppress(ValueError):
        parse(text)
    assert time.process_time() - started < 2.0
