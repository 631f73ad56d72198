"""Chunks larger than the arrays they belong to: HDF5 makes room for a whole chunk to read one number of it."""

from __future__ import annotations

import struct

from .case import add
from .groups_v2 import Damage, damaged
from .layout import Bytes
from .messages_v2 import FLETCHER, PATH, extent, header, messages, single
from .sizes import zeros

DEFLATE = struct.pack("<BBHHHI", 2, 1, 1, 0, 1, 9)
MIB = 1 << 20


def place(file: Bytes, path: str, declared: int, address: int, stored: int, filters: bytes) -> None:
    """An array of five numbers in a chunk that declares more."""
    count = declared // 4
    layout = single(address, stored, chunk=(count, 4), width=(count.bit_length() + 7) // 8)
    file.redirect(path, file.append(header(messages(file, space=extent(5), layout=layout, filters=filters))))


def packed(declared: int, contained: int, count: int = 1) -> Damage:
    """So many arrays whose chunk declares so much, and unpacks to as much as it contains."""

    def damage(file: Bytes) -> None:
        paths = [PATH] if count == 1 else [f"weights/more{i:03}" for i in range(count)]
        for path in paths:
            data = zeros(contained)
            place(file, path, declared, file.append(data), len(data), DEFLATE)

    return damage


def summed(size: int) -> Damage:
    """A hole in the file is one chunk, with the sum of zeros behind it."""
    return lambda file: place(file, PATH, size, file.append(bytes(size + 4)), size + 4, FLETCHER)


for name, damage in {
    "packed_16_mib": packed(16 * MIB, 16 * MIB),
    "packed_512_mib": packed(512 * MIB, 512 * MIB),
    "packed_2_gib": packed(2048 * MIB, 2048 * MIB),
    "packed_declares_2_gib": packed(2048 * MIB, 16 * MIB),
    "packed_unpacks_to_512_mib": packed(20, 512 * MIB),
    "60_of_16_mib": packed(16 * MIB, 16 * MIB, 60),
    "60_that_declare_256_mib": packed(256 * MIB, 16 * MIB, 60),
    "summed_16_mib": summed(16 * MIB),
    "summed_300_mib": summed(300 * MIB),
}.items():
    add(f"bombs.{name}", damaged(damage))
