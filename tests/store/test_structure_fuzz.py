"""HDF5's own structures changed at random, every checksum right: refused, or read within bounds, and nothing dies of it.

`SKILL_FUZZ` is how many changes of each format are tried, for at most half a minute each; the default tries a few, always the
same. A failure tells format and seed: `FOUND` in hostile/found.py keeps them, and the suite tries them again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from forked import MEGABYTES, forked
from hostile.found import FOUND
from hostile.mutation import FORMATS, base, mutated

from skillcli.errors import StoreError
from skillcli.store.container import unpack
from skillcli.store.hdf5_safety import DTYPES, plausible_total

pytestmark = pytest.mark.slow

EXAMPLES = int(os.environ.get("SKILL_FUZZ", "25"))
BOUNDED = EXAMPLES > 25
SECONDS = 30.0


def seeds() -> Iterator[int]:
    """The first few, or others at every run."""
    first, end = (int(time.time()) * 1000 if BOUNDED else 0), time.monotonic() + SECONDS
    for seed in range(first, first + EXAMPLES):
        if BOUNDED and time.monotonic() > end:
            return
        yield seed


def read(path: Path) -> dict[str, Any]:
    """What comes of a file, in a line or two."""
    try:
        _, contents = unpack(path, lambda *_: None)
    except StoreError as error:
        return {"refused": error.message}
    types = sorted({array.dtype.str for array in contents.arrays.values()})
    return {"bytes": sum(array.nbytes for array in contents.arrays.values()), "types": types}


def check(path: Path, form: str, seed: int) -> None:
    path.write_bytes(mutated(form, seed))
    end = forked(lambda: read(path))
    what = f"{form} {seed}: {end}"
    assert not end.signal and end.megabytes < MEGABYTES and "raised" not in end.value, what
    if "refused" in end.value:
        assert "\n" not in end.value["refused"], what
    else:
        assert end.value["bytes"] <= plausible_total(path.stat().st_size) and set(end.value["types"]) <= DTYPES, what


@pytest.mark.parametrize("form", FORMATS)
def test_changed_structures_are_refused_or_read_within_bounds(tmp_path: Path, form: str) -> None:
    wrong = []
    for seed in seeds():
        try:
            check(tmp_path / "file.h5", form, seed)
        except AssertionError as error:
            wrong.append(str(error).splitlines()[0])
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(("form", "seed"), [(form, seed) for form, seeds in FOUND.items() for seed in seeds])
def test_what_was_once_found_is_held_off(tmp_path: Path, form: str, seed: int) -> None:
    check(tmp_path / "file.h5", form, seed)


@pytest.mark.parametrize("form", FORMATS)
def test_the_unchanged_file_is_read(tmp_path: Path, form: str) -> None:
    path = tmp_path / "file.h5"
    path.write_bytes(base(form).data)
    assert read(path)["bytes"] > 500
