"""Small files that ask for much memory, time or disk."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

from .attributes import tampered
from .case import add, case
from .forge import Tamper, attribute, sealed
from .good import Good

GIB = 1 << 30


def replaced(
    path: str, shape: tuple[int, ...], dtype: str, write: Callable[[Any], object] = lambda _: None, **how: Any
) -> Tamper:
    """A dataset in place of another, made as told; `write` puts chunks into it."""

    def tamper(file: h5py.File) -> None:
        if path in file:
            del file[path]
        made = file.create_dataset(path, shape, dtype, track_times=False, **how)
        attribute(made, "dimensions", ",".join(f"axis{i}" for i in range(len(shape))))
        attribute(made, "unit", "")
        write(made)

    return tamper


def raw(data: bytes, mask: int = 0) -> Callable[[Any], object]:
    """One chunk as it will lie in the file."""
    return lambda made: made.id.write_direct_chunk((0,) * len(made.shape), data, filter_mask=mask)


def several(*tampers: Tamper) -> Tamper:
    def tamper(file: h5py.File) -> None:
        for one in tampers:
            one(file)

    return tamper


def zeros(count: int) -> bytes:
    """So many zeros, packed twice: 2 GiB are two megabytes, made without ever being there."""
    packer = zlib.compressobj(9)
    piece = bytes(1 << 24)
    return b"".join(packer.compress(piece) for _ in range(count >> 24)) + packer.flush()


def chunk_of_2_gib(made: Any) -> None:
    raw(zeros(2 * GIB))(made)


def many_groups(file: h5py.File) -> None:
    group = file["weights"]
    for _ in range(900):
        group = group.create_group("g")


def many_datasets(file: h5py.File) -> None:
    for i in range(20_000):
        file.create_group(f"weights/g{i:05d}")


def sharing(file: h5py.File) -> None:
    """2000 datasets, each told to lie where the first does, cannot be made by HDF5 alone; links to one can."""
    for i in range(900):
        file[f"weights/w{i}"] = file["weights/policy.body.2.weight"]


BIG = "weights/big"
EDGE = {"maxshape": None}
for name, tamper in {
    "chunk_of_2_gib_in_five_numbers": replaced(
        BIG, (5,), "f8", chunk_of_2_gib, chunks=(GIB // 4 - 1,), maxshape=(None,), compression="gzip"
    ),
    "chunk_larger_than_its_extent": replaced(
        BIG, (5,), "f8", raw(zlib.compress(bytes(8 << 20))), chunks=(1 << 20,), maxshape=(1 << 20,), compression="gzip"
    ),
    "60_datasets_of_256_mib_chunks": several(
        *(
            replaced(
                f"weights/big{i}",
                (5,),
                "f8",
                raw(zlib.compress(bytes(100))),
                chunks=(1 << 25,),
                maxshape=(1 << 25,),
                compression="gzip",
            )
            for i in range(60)
        )
    ),
    "chunk_unstored_of_1_gib": replaced(BIG, (5,), "f8", chunks=(GIB // 8,), maxshape=(GIB // 8,)),
    "chunk_that_unpacks_to_64_mib": replaced(BIG, (5, 3), "f8", raw(zeros(64 << 20)), chunks=(5, 3), compression="gzip"),
    "chunk_that_unpacks_to_less": replaced(BIG, (5, 3), "f8", raw(zlib.compress(bytes(8))), chunks=(5, 3), compression="gzip"),
    "chunk_packed_twice": replaced(
        BIG, (1 << 20,), "f8", raw(zlib.compress(zlib.compress(bytes(8 << 20)))), chunks=(1 << 20,), compression="gzip"
    ),
    "chunk_with_a_mask": replaced(BIG, (5, 3), "f8", raw(bytes(120), 1), chunks=(5, 3), compression="gzip"),
    "chunk_with_a_wrong_sum": replaced(BIG, (5, 3), "f8", raw(bytes(120) + b"\1\2\3\4"), chunks=(5, 3), fletcher32=True),
    "chunk_without_its_sum": replaced(BIG, (5, 3), "f8", raw(bytes(120)), chunks=(5, 3), fletcher32=True),
    "chunk_shorter_than_its_extent": replaced(BIG, (5, 3), "f8", raw(bytes(8)), chunks=(5, 3)),
    "chunk_longer_than_its_extent": replaced(BIG, (5, 3), "f8", raw(bytes(1 << 20)), chunks=(5, 3)),
    "4096_chunks_of_one_byte": replaced(
        BIG, (4096,), "u1", lambda made: made.write_direct(np.zeros(4096, "u1")), chunks=(1,), compression="gzip"
    ),
    "100000_chunks_declared": replaced(BIG, (100_000,), "u1", chunks=(1,), compression="gzip"),
    "chunks_beyond_64_bits": replaced(BIG, (2**40, 2**20), "u1", chunks=(1, 1), compression="gzip"),
    "extent_beyond_64_bits": replaced(BIG, (2**40, 2**40), "u1", chunks=(1 << 10, 1 << 10)),
    "a_gib_declared_and_not_stored": replaced(BIG, (GIB // 8,), "f8"),
    "47_mib_of_nothing": replaced(
        BIG,
        (47 << 20,),
        "u1",
        lambda made: made.write_direct(np.zeros(47 << 20, "u1")),
        chunks=(1 << 20,),
        compression="gzip",
        fletcher32=True,
        shuffle=True,
    ),
    "compact_data": lambda file: None,
    "shuffle_of_one_byte": replaced(
        BIG, (64,), "u1", raw(zlib.compress(bytes(64))), chunks=(64,), compression="gzip", shuffle=True
    ),
    "scaleoffset": replaced(BIG, (64,), "i4", lambda made: made.write_direct(np.zeros(64, "i4")), chunks=(64,), scaleoffset=2),
    "lzf": replaced(BIG, (64,), "i4", lambda made: made.write_direct(np.zeros(64, "i4")), chunks=(64,), compression="lzf"),
    "resizable": replaced(
        BIG, (64,), "f4", lambda made: made.write_direct(np.zeros(64, "f4")), chunks=(64,), maxshape=(None,), fletcher32=True
    ),
    "fill_value_in_place_of_data": replaced(BIG, (64,), "f4", chunks=(64,), fillvalue=3.0),
    "rank_of_32": replaced(
        BIG, (1,) * 32, "f4", lambda made: made.write_direct(np.zeros((1,) * 32, "f4")), chunks=(1,) * 32, fletcher32=True
    ),
    "extent_of_zero_times_everything": replaced(BIG, (0, 2**60), "f4"),
    "900_groups_deep": many_groups,
    "20000_groups": many_datasets,
    "900_names_for_one_array": sharing,
}.items():
    if name != "compact_data":
        harmless = {"shuffle_of_one_byte", "scaleoffset", "4096_chunks_of_one_byte", "47_mib_of_nothing"}
        add(f"sizes.{name}", tampered(tamper), "either" if name in harmless - {"scaleoffset"} else "refused")


@case()
def compact_data(good: Good) -> bytes:
    """Data inside the header of its dataset: well-formed, and not what the store writes."""

    def tamper(file: h5py.File) -> None:
        how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        how.set_layout(h5py.h5d.COMPACT)
        space = h5py.h5s.create_simple((64,))
        h5py.h5d.create(file["weights"].id, b"compact", h5py.h5t.IEEE_F32LE, space, how).write(space, space, np.ones(64, "f4"))

    return good.forged().file(tamper)


@case()
def sparse_chunk_of_a_gib(good: Good) -> bytes:
    """A hole of 300 MiB in the file is one chunk, and its sum is that of zeros; the file is said to be as long as it is."""
    count = 300 << 20

    def tamper(file: h5py.File) -> None:
        made = file.create_dataset("weights/big", (count,), "u1", chunks=(count,), fletcher32=True, track_times=False)
        made.id.write_direct_chunk((0,), bytes(count + 4))

    return good.forged().file(tamper)


@case()
def zeros_behind_the_end(good: Good) -> bytes:
    """300 MiB of nothing that no structure speaks of."""
    return sealed(good.forged().file() + bytes(300 << 20))


@case()
def garbage_behind_the_end(good: Good) -> bytes:
    return sealed(good.forged().file() + b"garbage" * 1000)


@case()
def two_files_in_one(good: Good) -> bytes:
    data = good.forged().file()
    return sealed(data + data)


@case()
def no_hdf5(good: Good) -> bytes:
    return sealed(good.forged().file()[:4096])


@case()
def only_a_signature(good: Good) -> bytes:
    return sealed(good.forged().file()[: 4096 + 8])


@case()
def hdf5_begins_later(good: Good) -> bytes:
    data = good.forged().file()
    return sealed(data[:4096] + bytes(4096) + data[4096:])


@case()
def half_of_it(good: Good) -> bytes:
    data = good.forged().file()
    return sealed(data[: len(data) // 2])


@case()
def a_size_that_is_a_lie(good: Good) -> bytes:
    return sealed(good.forged().file(), bytes=1 << 40)


@case()
def a_block_size_that_is_none(good: Good) -> bytes:
    data = good.forged().file()
    return data[:20] + b"0004097" + data[27:]


@case()
def driver_information(good: Good) -> bytes:
    """A file that says it is a family of files."""
    data = bytearray(good.forged().file())
    struct.pack_into("<Q", data, 4096 + 20, 0)  # a superblock extension where the superblock lies
    return sealed(bytes(data))
