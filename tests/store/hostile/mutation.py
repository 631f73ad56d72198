"""Changes of HDF5's own structures, not of data, with every checksum and hash made anew: what a fuzzer tries.

A change is a seed of a number generator: the same seed gives the same file, so a finding is kept as a number.
"""

from __future__ import annotations

import random
import re
import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .forge import Forged
from .good import NAME
from .layout import NONE, Bytes

OLD_STRUCTURES = re.compile(rb"TREE|SNOD|HEAP")
FORMATS = {"present": ("v110", "v110"), "first": ("earliest", "v110")}
WINDOW = 160  # bytes behind the begin of a structure in which most of what it says lies


@dataclass(frozen=True)
class Base:
    """A small good file and where its structures begin."""

    data: bytes
    starts: tuple[int, ...]  # addresses


@lru_cache(maxsize=8)
def base(form: str) -> Base:
    """A small artifact in one of HDF5's formats: groups of one and of two levels of B-trees, chunked and plain arrays."""
    data = _small(FORMATS[form]).file()
    file = Bytes(data)
    starts = {start for start, _, _ in file.structures} | {m.start() for m in OLD_STRUCTURES.finditer(data, file.base)}
    starts |= {
        file.at(file.header(path)) for path in ("/", "weights", "weights/w000", "weights/cube", "record", "record/recipe")
    }
    return Base(data, tuple(sorted(start - file.base for start in {*starts, file.base})))


def _small(libver: tuple[str, str]) -> Forged:
    arrays = {f"weights/w{i:03}": np.ones(1, np.float32) for i in range(60)}
    arrays |= {"weights/cube": np.zeros((3, 4, 5), np.float32), "weights/number": np.float32(1), "curves/none": np.zeros(0)}
    header = {
        "id": f"{NAME}/pretrain-v1", "kind": "pretrain", "schema_version": 1, "seed": 0, "recipe_name": "point", "parents": [],
        "created_utc": "2026-11-22T05:43:43.966019+00:00", "content_sha256": "", "inputs_sha256": "0" * 64,
    }  # fmt: skip
    texts = {"command": "skill", "recipe": {"name": "point"}, "results": {}, "measured": {}, "packages": {}, "parents": []}
    attributes = {"model_sha256": "", "git_commit": "", "git_dirty": 0}
    return Forged(header, attributes, texts, arrays, libver=libver)


def mutated(form: str, seed: int) -> bytes:
    """The base after one to four changes of what its structures say."""
    rng = random.Random(f"{form} {seed}")
    known = base(form)
    file = Bytes(known.data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        _change(file, known, rng)
    return file.file()


def _change(file: Bytes, known: Base, rng: random.Random) -> None:
    start = rng.choice(known.starts)
    place = start + int(WINDOW * rng.random() ** 2) + rng.choice((0, 0, 4))
    kind = rng.randrange(6)
    if kind == 0:
        _put(file, place, bytes([rng.randrange(256)]))
    elif kind == 1:
        _put(file, place, bytes([file.data[min(file.at(place), len(file.data) - 1)] ^ 1 << rng.randrange(8)]))
    elif kind == 2:
        _put(file, place, struct.pack("<H", rng.choice((0, 1, 2, 255, 32767, 65535))))
    elif kind == 3:
        _put(file, place, struct.pack("<I", rng.choice((0, 1, 8, 1 << 16, 1 << 28, 2**31 - 1, 2**31, 2**32 - 1))))
    elif kind == 4:
        _address(file, known, start, rng)
    else:  # what another structure says at the same place
        other = file.at(rng.choice(known.starts) + place - start)
        _put(file, place, bytes(file.data[other : other + rng.choice((1, 2, 4, 8, 16))]))


def _address(file: Bytes, known: Base, start: int, rng: random.Random) -> None:
    """Something that looks like an address becomes another one: of the structure itself, of another, of nothing."""
    end = file.base + len(file.data)
    places = [p for p in range(start, start + 240) if p + 8 + file.base <= len(file.data) and 0 < file.peek(p, "Q") < end]
    new = rng.choice((start, start, rng.choice(known.starts), rng.choice(known.starts), NONE, 0, 1 << 50, 2**64 - 4096))
    _put(file, rng.choice(places or [start]), struct.pack("<Q", new))


def _put(file: Bytes, address: int, piece: bytes) -> None:
    place = min(file.at(address), len(file.data) - len(piece))
    file.data[place : place + len(piece)] = piece
