"""One file of the store: the block at its start, then HDF5 with text and integer attributes and plain arrays."""

from __future__ import annotations

import errno
import io
import os
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from skillcli.errors import StoreError
from skillcli.paths import open_regular
from skillcli.store import block, known, quarantine
from skillcli.store.canonical_json import parse
from skillcli.store.hdf5_reader import FAULTS, first_line, list_contents, read_array
from skillcli.store.hdf5_safety import DTYPES, MAX_BYTES, PATH, plausible_total

Array = NDArray[Any]
Labels = Callable[[str, int], tuple[str, str]]
Shapes = Mapping[str, tuple[int, ...]]
Written = Mapping[str, tuple[str, str]]  # by path: dimension names and unit as in the file
Check = Callable[[Mapping[str, Any], Shapes, Written], None]
Compare = Callable[[int, Written, Shapes], None]

RECORD = "record"
"""Group of the JSON texts, stored as bytes because an attribute holds at most 64 kB."""

_CHUNK_BYTES = 1 << 20
_FORMAT = ("v110", "v110")  # readable since HDF5 1.10 (2016); small datasets cost no index of their own


@dataclass(frozen=True)
class Contents:
    """The HDF5 part of a file: attributes of the root, and arrays by path."""

    attributes: Mapping[str, str | int]
    arrays: Mapping[str, Array]


def checked_arrays(arrays: Mapping[str, Any]) -> dict[str, Array]:
    """Return the arrays as they are stored: little-endian, contiguous, with a type and path that can be read back.

    Raises:
        StoreError: one of them cannot be stored.
    """
    checked = {}
    for path, value in arrays.items():
        array = np.asarray(value)
        array = np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")
        if array.dtype.str not in DTYPES:
            raise StoreError(f"array {path} has the type {array.dtype}", "use integers, floats or booleans")
        if not PATH.fullmatch(path) or path.split("/")[0] == RECORD:
            raise StoreError(f"array {path!r} cannot be stored under this path", "use one like weights/policy/0.weight")
        checked[path] = array
    total = sum(array.nbytes for array in checked.values())
    if total > MAX_BYTES:
        raise StoreError(f"the arrays take {total} bytes, at most {MAX_BYTES} fit in one file", "record fewer episodes")
    return checked


def text_array(text: str) -> Array:
    """Return a text as bytes, (n,) uint8."""
    return np.frombuffer(text.encode(), dtype=np.uint8)


def parse_record(contents: Contents, name: str) -> Any:
    """Return the JSON value stored under `record/NAME`.

    Raises:
        ValueError: it is not JSON text.
        KeyError: it is missing.
    """
    return parse(contents.arrays[f"{RECORD}/{name}"].tobytes())


def pack(header: Mapping[str, Any], contents: Contents, labels: Labels, *, gzip: bool = True) -> memoryview:
    """Return the bytes of a finished file.

    They are made in memory and written at once, so that a full disk fails in a plain write and not inside HDF5.

    Args:
        header: for the block; its `bytes` becomes the size of the file.
        contents: the HDF5 part.
        labels: from path and number of dimensions to the dimensions' names and the unit.
        gzip: whether to compress arrays that get smaller.

    Raises:
        StoreError: HDF5 cannot store it.
    """
    try:
        size = block.block_size({**header, "bytes": 10 * MAX_BYTES})
        total = sum(array.nbytes for array in contents.arrays.values())
        buffer = _write_hdf5(contents, labels, size, gzip)
        if total > plausible_total(buffer.getbuffer().nbytes):  # mostly zeros: compressed, it would look like a zip bomb
            buffer = _write_hdf5(contents, labels, size, gzip=False)
        known.remember(block.seal(buffer, {**header, "bytes": buffer.getbuffer().nbytes}, size))
    except FAULTS as error:
        raise StoreError(f"this cannot be stored: {first_line(error)}") from error
    return buffer.getbuffer()


def _write_hdf5(contents: Contents, labels: Labels, block_size: int, gzip: bool) -> io.BytesIO:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=block_size, libver=_FORMAT) as file:
        for name, value in contents.attributes.items():
            _write_attribute(file, name, value)
        for path, array in sorted(contents.arrays.items()):
            dataset = file.create_dataset(path, data=array, track_times=False, **_storage(array, gzip))
            for name, text in zip(("dimensions", "unit"), labels(path, array.ndim), strict=True):
                _write_attribute(dataset, name, text)
    return buffer


def peek(path: Path | str) -> dict[str, Any]:
    """Read the header alone, a few kilobytes of the file.

    Raises:
        StoreError: the file does not belong to a store, or is not complete.
    """
    with _opened(path) as file:
        return _header(file)[0]


def may_mention(path: Path | str, text: str) -> bool:
    """Return whether the header of a file may contain this JSON string; never wrongly False.

    Raises:
        StoreError: the file cannot be read.
    """
    with _opened(path) as file:
        return block.may_mention(file, text)


def unpack(path: Path, check: Check) -> tuple[dict[str, Any], Contents]:
    """Read a file that may be damaged or hostile: first its hash, then its structure, and only then its data.

    A file that was not written here is parsed in a separate process, see `quarantine`.

    Args:
        path: the file.
        check: called with the header, and shape and labels of every array before any is read; may raise a StoreError.

    Raises:
        StoreError: the file is missing, damaged or refused.
    """
    with _opened(path) as file:
        header, size = _header(file)
        digest = block.recorded_digest(file)
        read = _read_here if known.is_known(digest) else _read_elsewhere
        if read is _read_elsewhere and header["bytes"] > quarantine.MAX_FILE_BYTES:
            raise ValueError(f"it has {header['bytes']} bytes, at most {quarantine.MAX_FILE_BYTES} are read from elsewhere")
        block.check_digest(file)
        block.check_spelling(file, header)
        if _end_of_hdf5(file, size) != header["bytes"]:
            raise ValueError("something lies behind its HDF5 part, or a part of that is missing")

        def compare(userblock: int, labels: Written, shapes: Shapes) -> None:
            if userblock != size:
                raise ValueError("its HDF5 part does not begin behind the header")
            for path, (dimensions, _) in labels.items():
                if len([name for name in dimensions.split(",") if name]) != len(shapes[path]):
                    raise ValueError(f"{path} has the shape {shapes[path]}, and dimensions named {dimensions!r}")
            check(header, shapes, labels)

        return header, read(file, header["bytes"], compare)


def _end_of_hdf5(file: BinaryIO, start: int) -> int:
    """Return where the HDF5 part says that it ends, in bytes from the beginning of the file."""
    file.seek(start)
    superblock = file.read(64)
    place = 28 if superblock[8:9] >= b"\2" else 40  # HDF5 file format specification, version 3, II.A
    return int.from_bytes(superblock[place : place + 8], "little")


def _read_here(file: BinaryIO, stored: int, compare: Compare) -> Contents:
    with h5py.File(file, "r") as hdf5:
        listing = list_contents(hdf5, stored)
        compare(listing.userblock, listing.labels, {name: dataset.shape for name, dataset in listing.datasets.items()})
        return Contents(listing.attributes, {name: read_array(dataset) for name, dataset in listing.datasets.items()})


def _read_elsewhere(file: BinaryIO, stored: int, compare: Compare) -> Contents:
    described, arrays = quarantine.read_elsewhere(file, lambda told: compare(told.userblock, told.labels, told.shapes))
    return Contents(described.attributes, arrays)


@contextmanager
def reading(path: Path | str, hint: str = "restore it from a copy, or remove it") -> Iterator[None]:
    """Turn any error of reading a file into one StoreError with this hint."""
    try:
        yield
    except FAULTS as error:
        if isinstance(error, OSError) and error.errno in (errno.EACCES, errno.EPERM):
            hint = "ask its owner to let you read it"
        reason = error.strerror if isinstance(error, OSError) and error.strerror else first_line(error)
        raise StoreError(f"cannot read {path}: {reason}", hint) from error


@contextmanager
def _opened(path: Path | str) -> Iterator[BinaryIO]:
    with reading(path), open_regular(path) as file:
        yield file


def _header(file: BinaryIO) -> tuple[dict[str, Any], int]:
    header, size = block.read_block(file)
    length = os.fstat(file.fileno()).st_size
    if header.get("bytes") != length:
        raise ValueError(f"it has {length} bytes, {header.get('bytes')} were written")
    return header, size


def _storage(array: Array, gzip: bool) -> dict[str, Any]:
    """Choose how HDF5 stores one array; single numbers and empty arrays cannot have a checksum of their own."""
    if array.ndim == 0 or array.size == 0:
        return {}
    pieces = min(len(array), -(-array.nbytes // _CHUNK_BYTES))
    rows = -(-len(array) // pieces)  # equal pieces: the last one takes its full size too
    packing = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if gzip and _is_worth_packing(array) else {}
    return {"chunks": (rows, *array.shape[1:]), "fletcher32": True, **packing}


def _is_worth_packing(array: Array) -> bool:
    """Return whether gzip saves a tenth of the first 64 kB, with bytes of equal significance put together."""
    sample = array.ravel()[: max(1, (1 << 16) // array.itemsize)].tobytes()
    shuffled = np.frombuffer(sample, np.uint8).reshape(-1, array.itemsize).T.tobytes()
    return len(sample) >= 256 and len(zlib.compress(shuffled, 1)) < 0.9 * len(sample)


def _write_attribute(item: Any, name: str, value: str | int) -> None:
    if isinstance(value, int):
        item.attrs.create(name, np.int64(value))
    else:
        data = value.encode()
        item.attrs.create(name, np.bytes_(data), dtype=h5py.string_dtype("utf-8", max(1, len(data))))
