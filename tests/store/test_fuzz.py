"""Random damage, also behind a valid hash: a store refuses or reads, in bounded time, and never does anything else.

`SKILL_FUZZ` is how many examples each test tries; the default keeps `make test` quick.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import draft
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Store, block, export, import_file
from skillcli.store.artifact import content_hash

pytestmark = pytest.mark.slow

EXAMPLES = int(os.environ.get("SKILL_FUZZ", "25"))
SECONDS = 2.0

fuzz = settings(
    max_examples=EXAMPLES,
    deadline=SECONDS * 1000,
    derandomize=EXAMPLES <= 25,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
JSON = some.recursive(
    some.none() | some.booleans() | some.integers() | some.floats() | some.text(),
    lambda inner: some.lists(inner, max_size=3) | some.dictionaries(some.text(), inner, max_size=3),
    max_leaves=8,
)
FIELDS = (
    "id", "kind", "schema_version", "created_utc", "seed", "recipe_name", "parents", "content_sha256", "inputs_sha256", "bytes",
)  # fmt: skip
# A change of bytes: where (as a share of the file), and what comes there.
CHANGES = some.lists(
    some.tuples(some.floats(0, 1, exclude_max=True), some.binary(min_size=1, max_size=9)), min_size=1, max_size=12
)


@pytest.fixture(scope="module")
def good() -> Iterator[tuple[Store, ArtifactId, bytes]]:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder) / "artifacts")
        artifact = store.write(draft("compose", parents=[store.write(draft()).id])).id
        yield store, artifact, store.path(artifact).read_bytes()


def put(store: Store, artifact: ArtifactId, data: bytes) -> None:
    store.path(artifact).write_bytes(data)


def sealed(data: bytes, **changes: Any) -> bytes:
    """The file with the size and hash it would have if it were honest."""
    file = io.BytesIO(data)
    header, size = block.read_block(file)
    block.seal(file, {**header, "bytes": len(data), **changes}, size)
    return file.getvalue()


def check(store: Store, artifact: ArtifactId) -> None:
    """Reading refuses with one line, or gives what verification agrees with."""
    problems = store.verify(artifact)
    try:
        found = store.read(artifact)
    except StoreError as error:
        assert problems and "\n" not in error.message
    else:
        assert bool(problems) == (content_hash(found) != found.content_sha256)
    store.listing()


def changed(data: bytes, changes: list[tuple[float, bytes]], first: int) -> bytes:
    damaged = bytearray(data)
    for share, piece in changes:
        start = first + int(share * (len(data) - first - len(piece)))
        damaged[start : start + len(piece)] = piece
    return bytes(damaged)


@fuzz
@given(changes=CHANGES)
def test_changed_bytes_are_always_reported(good: tuple[Store, ArtifactId, bytes], changes: list[tuple[float, bytes]]) -> None:
    store, artifact, data = good
    damaged = changed(data, changes, 0)
    put(store, artifact, damaged)
    assert (store.verify(artifact) == []) == (damaged == data)
    check(store, artifact)


@fuzz
@given(changes=CHANGES, dense=some.booleans())
def test_changed_structure_behind_a_valid_hash(
    good: tuple[Store, ArtifactId, bytes], changes: list[tuple[float, bytes]], dense: bool
) -> None:
    store, artifact, data = good
    first = block.SMALLEST
    if dense:  # all in the first kilobytes, where HDF5 keeps most of its structure
        data = data[:first] + changed(data[first : first + 3000], changes, 0) + data[first + 3000 :]
    else:
        data = changed(data, changes, first)
    put(store, artifact, sealed(data))
    check(store, artifact)


@fuzz
@given(field=some.sampled_from([*FIELDS, "surprise"]), value=JSON)
def test_headers_that_say_anything(good: tuple[Store, ArtifactId, bytes], field: str, value: Any) -> None:
    store, artifact, data = good
    try:
        put(store, artifact, sealed(data, **{field: value}))
    except ValueError:  # NaN, or longer than the block: nothing can be stored so
        return
    check(store, artifact)
    put(store, artifact, data)


@fuzz
@given(changes=CHANGES, cut=some.floats(0.5, 1), manifest=some.none() | JSON)
def test_exports_that_somebody_changed(
    good: tuple[Store, ArtifactId, bytes], changes: list[tuple[float, bytes]], cut: float, manifest: Any
) -> None:
    store, artifact, data = good
    put(store, artifact, data)
    with tempfile.TemporaryDirectory() as folder:
        path, other = Path(folder) / "x.tar", Store(Path(folder) / "other")
        export(store, artifact, path)
        packed = path.read_bytes()
        if manifest is not None:
            text = json.dumps(manifest).encode()
            packed = packed[:512] + text.ljust(1024, b"\0") + packed[512 + len(text) :]
        path.write_bytes(changed(packed[: int(cut * len(packed))], changes, 0))
        try:
            import_file(other, path)
        except StoreError as error:
            assert "\n" not in error.message
        assert [problem for one in other.ids() for problem in other.verify(one)] == []
        assert not list(other.root.glob(".tmp*"))
        assert {entry.name for entry in Path(folder).iterdir()} <= {"x.tar", "other"}


@fuzz
@given(text=some.text(max_size=80) | some.from_regex(r"[a-z./]{0,20}/(pretrain|compose)-v[0-9]{1,12}", fullmatch=True))
def test_ids_never_leave_the_store(text: str) -> None:
    try:
        one = ArtifactId.parse(text)
    except StoreError:
        return
    root = Path("/store")
    assert str(one) == text and one.path(root).resolve().is_relative_to(root)
