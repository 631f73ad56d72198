"""The bytes of an HDF5 file: where its structures lie, and their checksums made anew after a change.

After the "HDF5 File Format Specification", version 3.0. All addresses in a file count from the end of the block in front.
"""

from __future__ import annotations

import io
import re
import struct
from functools import lru_cache
from typing import Any

import h5py

from .forge import sealed

NONE = 2**64 - 1  # an address of nothing
_CHECKED = re.compile(rb"OHDR|OCHK|BTHD|BTLF|BTIN|FRHP|FHDB|FHIB|FSHD|FSSE|FAHD|FADB|EAHD|EAIB|EASB|EADB")
_MASK = 0xFFFFFFFF


class Bytes:
    """A file of the store to be changed byte by byte."""

    def __init__(self, data: bytes) -> None:
        self.data = bytearray(data)
        self.base = int(data[20:27])
        self.good = data
        self.structures = structures(data)

    def at(self, address: int) -> int:
        """Where in the file an address points."""
        return self.base + address

    def header(self, path: str) -> int:
        """Address of the object header of a group or a dataset, in the good file."""
        return header(self.good, path)

    def find(self, signature: bytes, nth: int = 0, after: int = 0) -> int:
        """Address of the nth structure with a signature."""
        position = self.at(after) - 1
        for _ in range(nth + 1):
            position = self.data.index(signature, position + 1)
        return position - self.base

    def peek(self, address: int, form: str) -> int:
        return int(struct.unpack_from(f"<{form}", self.data, self.at(address))[0])

    def poke(self, address: int, form: str, *values: Any) -> Bytes:
        struct.pack_into(f"<{form}", self.data, self.at(address), *values)
        return self

    def append(self, block: bytes) -> int:
        """Put something behind the end, and move the end of the file; returns its address."""
        self.data += bytes(-len(self.data) % 8)
        address = len(self.data) - self.base
        self.data += block
        version = self.data[self.base + 8]
        self.poke(28 if version >= 2 else 40, "Q", len(self.data))
        return address

    def redirect(self, path: str, address: int) -> Bytes:
        """Make the link to an object point elsewhere."""
        old, name = struct.pack("<Q", self.header(path)), path.rpartition("/")[2].encode()
        new, found = struct.pack("<Q", address), 0
        for piece, other in ((name + old, name + new), (old + bytes(8), new + bytes(8))):  # by name; in a symbol table
            found += self.data.count(piece)
            self.data[:] = self.data.replace(piece, other)
        assert found == 1, f"{found} links to {path}"
        return self

    def file(self) -> bytes:
        """The file with all checksums and hashes right."""
        for start, end, where in self.structures:
            struct.pack_into("<I", self.data, where, _sum(self.data, start, end, where))
        if self.data[self.base + 8] >= 2:
            struct.pack_into("<I", self.data, self.base + 44, lookup3(bytes(self.data[self.base : self.base + 44])))
        return sealed(bytes(self.data))


@lru_cache(maxsize=16)
def structures(data: bytes) -> tuple[tuple[int, int, int], ...]:
    """Begin and end of every structure of a good file that has a checksum, and where that lies."""
    return tuple(filter(None, (_structure(data, match) for match in _CHECKED.finditer(data, int(data[20:27])))))


def _structure(data: bytes, match: re.Match[bytes]) -> tuple[int, int, int] | None:
    start = match.start()
    if match[0] == b"OHDR":
        places = [(_ohdr_end(data, start),) * 2]
    elif match[0] == b"FHDB":  # keeps its sum inside, counted as zero, behind an offset of 4 (links) or 5 bytes (attributes)
        places = [(start + (512 << i), start + where) for i in range(8) for where in (17, 18)]
    else:
        places = [(end, end) for end in range(start + 8, start + 1500)]
    for end, where in places:
        if max(end, where + 4) <= len(data) and _sum(data, start, end, where) == struct.unpack_from("<I", data, where)[0]:
            return start, end, where
    return None


def _sum(data: bytes | bytearray, start: int, end: int, where: int) -> int:
    block = bytearray(data[start:end])
    if where < end:
        block[where - start : where - start + 4] = bytes(4)
    return lookup3(bytes(block))


def _ohdr_end(data: bytes, start: int) -> int:
    flags = data[start + 5]
    first = start + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
    width = 1 << (flags & 3)
    return first + width + int.from_bytes(data[first : first + width], "little")


def lookup3(data: bytes) -> int:
    """Bob Jenkins' hash as HDF5 uses it for its metadata."""
    word = [(0xDEADBEEF + len(data)) & _MASK] * 3
    blocks = max(1, -(-len(data) // 12))
    for number, block in enumerate(struct.iter_unpack("<3I", data.ljust(12 * blocks, b"\0"))):
        word = [(old + new) & _MASK for old, new in zip(word, block, strict=True)]
        if number < blocks - 1:
            for x, y, z, bits in _MIX:
                word[x] = (word[x] - word[y]) & _MASK ^ _turn(word[y], bits)
                word[y] = word[y] + word[z] & _MASK
    for x, y, bits in _FINAL:
        word[x] = (word[x] ^ word[y]) - _turn(word[y], bits) & _MASK
    return word[2]


@lru_cache(maxsize=256)
def header(data: bytes, path: str) -> int:
    with h5py.File(io.BytesIO(data), "r") as file:
        return int(h5py.h5o.get_info(file[path].id).addr)


_MIX = ((0, 2, 1, 4), (1, 0, 2, 6), (2, 1, 0, 8), (0, 2, 1, 16), (1, 0, 2, 19), (2, 1, 0, 4))
_FINAL = ((2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24))


def _turn(x: int, bits: int) -> int:
    return (x << bits | x >> (32 - bits)) & _MASK
