"""JSON texts inside: depth, width, numbers, types, markup and escapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .case import add
from .good import Good

MARKUP = "[/] [bold]x[/bold] [link=file:///etc/passwd]y[/link] [not a tag"
ESCAPES = "\x1b[2J\x1b]0;title\x07\r\b\x9b31m\u202e\u2028\x00"


def text(part: str, value: Any) -> Callable[[Good], bytes]:
    """One of the texts says this; bytes are taken word by word."""

    def build(good: Good) -> bytes:
        copy = good.forged()
        copy.rehash()
        kept = copy.texts[part]
        copy.texts[part] = {**kept, **value} if isinstance(value, dict) and isinstance(kept, dict) else value
        return copy.file(rehash=not isinstance(value, bytes))

    return build


def nested(depth: int, around: str = "[]") -> bytes:
    return b'{"a":' + around[0].encode() * depth + around[1].encode() * depth + b"}"


def deep(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth):
        value = [value]
    return value


WIDE = b'{"a":[' + b"0," * 499_999 + b"0]}"
for part in ("results", "measured", "recipe", "packages"):
    add(f"texts.{part}_nested_930_deep", text(part, {"deep": deep(930)}))
    add(f"texts.{part}_nested_100000_deep", text(part, nested(100_000)))
    add(f"texts.{part}_is_a_list", text(part, [1]))
    add(f"texts.{part}_with_nan", text(part, b'{"a":NaN}'))
    add(f"texts.{part}_of_500000_numbers", text(part, {"many": [0] * 500_000}), "either" if part == "results" else "refused")
    add(f"texts.{part}_of_markup", text(part, {"markup": MARKUP, MARKUP: MARKUP}), "either")
    add(f"texts.{part}_of_escapes", text(part, {"escape": ESCAPES, ESCAPES: 1}), "either")
    add(f"texts.{part}_with_a_lone_surrogate", text(part, {"a": "\ud800", "\udfff": "b"}), "either")
    add(f"texts.{part}_with_a_huge_integer", text(part, b'{"a":' + b"9" * 4000 + b"}"))
    add(f"texts.{part}_with_a_number_that_overflows", text(part, b'{"a":1e999}'))
    add(f"texts.{part}_with_a_key_twice", text(part, b'{"a":1,"a":2}'))
    add(f"texts.{part}_is_not_utf8", text(part, b'{"a":"\xff"}'))
for name, value in {
    "60000_packages": ("packages", {f"p{i}": "1" for i in range(60_000)}),
    "60000_recipe_sections": ("recipe", {f"s{i}": {} for i in range(40_000)}),
    "60000_results": ("results", {f"r{i}": i for i in range(60_000)}),
    "package_version_of_900_kB": ("packages", {"numpy": "1" * 900_000}),
    "package_version_is_a_list": ("packages", {"numpy": [1, 2]}),
    "no_packages": ("packages", b"{}"),
    "command_is_a_number": ("command", 3),
    "command_of_900_kB": ("command", "skill " + "x" * 900_000),
    "command_of_escapes": ("command", ESCAPES),
    "command_of_markup": ("command", MARKUP),
    "migrated_from_itself": ("measured", {"migrated_from": {"id": "[/]", "content_sha256": 3, "command": ESCAPES}}),
    "migrated_from_nothing": ("measured", {"migrated_from": None}),
    "throughput_is_a_text": ("measured", {"throughput": MARKUP, "wall_seconds": "long", "peak_memory_mb": []}),
    "results_say_less": ("results", b"{}"),
    "skills_are_a_text": ("results", {"skills": MARKUP}),
    "skills_are_fewer": ("results", {"skills": []}),
    "success_rate_is_a_text": ("results", {"success_rate": MARKUP}),
    "success_rate_beyond_one": ("results", {"success_rate": 1e300}),
    "embedding_is_a_number": ("results", {"embedding": 3}),
    "env_steps_below_zero": ("results", {"env_steps": -(10**30)}),
    "parents_differ": ("parents", b'[{"content_sha256":"0","id":"a/pretrain-v1"}]'),
    "empty": ("results", b""),
    "two_megabytes_of_brackets": ("results", b"[" + b"[]," * (1 << 19) + b"0]"),
}.items():
    harmless = {"package_version_of_900_kB", "command_of_900_kB", "command_of_escapes", "command_of_markup", "no_packages",
                "throughput_is_a_text", "migrated_from_nothing", "migrated_from_itself", "60000_results"}  # fmt: skip
    add(f"texts.{name}", text(*value), "either" if name in harmless else "refused")
