"""What the block in front says: keys, ids, times, names, parents."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from .case import add, case
from .forge import START, Forged, canonical, sealed
from .good import CHAIN, NAME, Good


def changed(**changes: Any) -> Callable[[Good], bytes]:
    """The header says so, and so does everything inside that repeats it."""

    def build(good: Good) -> bytes:
        copy = good.forged()
        copy.header |= changes
        return fitting(copy)

    return build


def fitting(copy: Forged) -> bytes:
    """The file, with a block in which even a long header fits."""
    while len(canonical(copy.header)) + 300 > copy.block:
        copy.block *= 2
    return copy.file()


def parents(count: int) -> list[dict[str, str]]:
    return [{"id": f"made-up-{i}/pretrain-v1", "content_sha256": f"{i:064x}"} for i in range(count)]


SHA = "0" * 64
TIME = "2026-11-22T05:43:43.966019+00:00"
HARMLESS = (
    "one_parent_of_a_pretrain",
    "version_of_nine_digits",  # such a number becomes the next free one
)

for name, changes in {
    "other_recipe_name": {"recipe_name": "reach"},
    "no_recipe_name": {"recipe_name": ""},
    "recipe_name_of_200_letters": {"recipe_name": "a" * 200},
    "recipe_name_of_markup": {"recipe_name": "[/]"},
    "time_that_is_none": {"created_utc": "yesterday"},
    "no_time": {"created_utc": ""},
    "time_of_year_9999": {"created_utc": "9999-12-31T23:59:59.999999+00:00"},
    "time_of_year_1": {"created_utc": "0001-01-01T00:00:00.000000+00:00"},
    "time_of_month_13": {"created_utc": TIME.replace("-11-", "-13-")},
    "time_without_zone": {"created_utc": TIME[:-6]},
    "time_of_another_zone": {"created_utc": TIME[:-6] + "+14:00"},
    "time_with_other_digits": {"created_utc": TIME.replace("2026", "٢٠٢٦")},
    "time_of_100_kB": {"created_utc": "2" * 100_000},
    "name_of_200_letters": {"id": f"{'a' * 200}/pretrain-v1"},
    "version_of_nine_digits": {"id": f"{NAME}/pretrain-v999999999"},
    "version_of_ten_digits": {"id": f"{NAME}/pretrain-v9999999999"},
    "version_zero": {"id": f"{NAME}/pretrain-v0"},
    "id_that_leaves_the_store": {"id": "../../etc/pretrain-v1"},
    "id_with_a_line": {"id": f"{NAME}/pretrain-v1\n"},
    "other_stage": {"id": f"{NAME}/compose-v1"},
    "schema_of_the_future": {"schema_version": 10**6},
    "schema_beyond_64_bits": {"schema_version": 2**63 - 1},
    "seed_below_zero": {"seed": -1},
    "seed_of_the_smallest": {"seed": -(2**63)},
    "ten_thousand_parents": {"parents": parents(6_000)},
    "one_parent_of_a_pretrain": {"parents": parents(1)},
    "itself_as_parent": {"parents": [{"id": f"{NAME}/pretrain-v1", "content_sha256": SHA}]},
    "parent_of_markup": {"parents": [{"id": "[/]/pretrain-v1", "content_sha256": SHA}]},
    "parent_hash_of_markup": {"parents": [{"id": f"{CHAIN}/pretrain-v1", "content_sha256": "[/]" * 30}]},
    "parent_with_more_keys": {"parents": [{"id": f"{CHAIN}/pretrain-v1", "content_sha256": SHA, "more": "x" * 900}]},
    "parent_twice": {"parents": 2 * parents(1)},
    "inputs_that_are_no_hash": {"inputs_sha256": "[red]" + "x" * 50},
    "inputs_of_a_megabyte": {"inputs_sha256": "x" * 900_000},
}.items():
    add(f"header.{name}", changed(**changes), "either" if name in HARMLESS else "refused")


def spelled(change: Callable[[str], str | bytes]) -> Callable[[Good], bytes]:
    """The header's words after a change; what lies inside stays as it was."""

    def build(good: Good) -> bytes:
        data = good.forged().file()
        return sealed(data, text=change(data[START:4096].split(b"\n")[0].decode()))

    return build


def member(key: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        spelling = json.dumps(json.loads(text)[key], separators=(",", ":"))
        return text.replace(f'"{key}":{spelling}', f'"{key}":{value}')

    return change


for name, change in {
    "key_twice": lambda text: '{"seed":0,' + text[1:],
    "key_twice_and_different": lambda text: '{"seed":77,' + text[1:],
    "id_twice": lambda text: '{"id":"other/pretrain-v1",' + text[1:],
    "unknown_key": lambda text: text[:-1] + ',"z":1}',
    "escaped_key": lambda text: text.replace('"seed"', '"se\\u0065d"'),
    "spaces": lambda text: text.replace(":", ": "),
    "keys_in_another_order": lambda text: canonical_reversed(text),
    "seed_of_fractions": member("seed", "0.0"),
    "seed_with_an_exponent": member("seed", "0e5"),
    "seed_of_minus_zero": member("seed", "-0"),
    "seed_is_true": member("seed", "true"),
    "seed_of_3000_digits": member("seed", "1" * 3000),
    "size_of_fractions": lambda text: text.replace('"bytes":', '"bytes":1e9,"byte":'),
    "lone_surrogate": member("recipe_name", '"\\ud800"'),
    "terminal_escape": member("recipe_name", '"\\u001b[2J"'),
    "right_to_left": member("recipe_name", '"\\u202etniop"'),
    "not_utf8": lambda text: text.encode().replace(b'"point"', b'"\xff\xfe"'),
    "parents_is_an_object": member("parents", "{}"),
    "parents_are_numbers": member("parents", "[1,2]"),
    "parents_are_lists": member("parents", "[" * 900 + "]" * 900),
    "parents_nested_too_deep": member("parents", "[" * 1500),
    "null": lambda _: "null",
    "a_list": lambda text: f"[{text}]",
    "nothing": lambda _: "",
    "two_objects": lambda text: text + text[:100],
    "not_a_number": member("seed", "NaN"),
    "byte_order_mark": lambda text: "\ufeff" + text,
}.items():
    add(f"header.{name}", spelled(change))


def canonical_reversed(text: str) -> str:
    return json.dumps(dict(reversed(json.loads(text).items())), separators=(",", ":"))


def without(kind: str) -> Callable[[Good], bytes]:
    def build(good: Good) -> bytes:
        copy = good.forged(kind)
        copy.header["parents"] = []
        return copy.file()

    return build


def adopted(kind: str, parent: str) -> Callable[[Good], bytes]:
    """Made from something else than this kind is made from."""

    def build(good: Good) -> bytes:
        copy, other = good.forged(kind), good.forged(parent)
        copy.header["parents"] = [{"id": f"{CHAIN}/{parent}-v1", "content_sha256": other.header["content_sha256"]}]
        return copy.file()

    return build


for made in ("embed-means", "compose", "transfer-eval"):
    add(f"header.no_parent_of_{made}", without(made), kind=made)
for made, of in (("embed-means", "compose"), ("compose", "transfer-eval"), ("transfer-eval", "transfer-eval")):
    add(f"header.{made}_of_{of}", adopted(made, of), kind=made)


@case(kind="embed-means")
def parent_with_another_hash(good: Good) -> bytes:
    copy = good.forged("embed-means")
    copy.header["parents"][0]["content_sha256"] = SHA
    return copy.file()


@case(kind="embed-means")
def parent_that_is_nowhere(good: Good) -> bytes:
    copy = good.forged("embed-means")
    copy.header["parents"][0]["id"] = "nowhere/pretrain-v1"
    return copy.file()


@case(kind="compose")
def own_parent(good: Good) -> bytes:
    copy = good.forged("compose")
    copy.header["parents"][0]["id"] = f"{NAME}/compose-v1"
    return copy.file()


@case()
def block_of_a_megabyte(good: Good) -> bytes:
    copy = good.forged()
    copy.block = 1 << 20
    copy.header["recipe_name"] = "a" * 1_000_000
    return copy.file()


@case("either")
def block_larger_than_needed(good: Good) -> bytes:
    copy = good.forged()
    copy.block = 1 << 20
    return copy.file()


@case("either", kind="embed-means")  # whoever uses it again works out its inputs anew
def inputs_of_another_seed(good: Good) -> bytes:
    """Says that it was made from what this chain would make next."""
    copy = good.forged("embed-means")
    copy.header["inputs_sha256"] = good.forged("compose").header["inputs_sha256"]
    return copy.file()
