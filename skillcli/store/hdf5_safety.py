"""Check the structure of an HDF5 file before its data is read: the file may be hostile, and HDF5 obeys it.

A hostile file can point outside itself (links, external storage, virtual datasets), declare gigabytes in a kilobyte,
unpack to more than it declares, or name a group inside itself. The checks here read only the structure, and compressed
chunks, which are unpacked in small steps and thrown away.
"""

from __future__ import annotations

import math
import re
import zlib
from typing import Any

import h5py
import numpy as np

DTYPES = frozenset(["|b1", "|i1", "<i2", "<i4", "<i8", "|u1", "<u2", "<u4", "<u8", "<f2", "<f4", "<f8"])
PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+=-]*(/[A-Za-z0-9_][A-Za-z0-9_.+=-]*){0,7}", re.ASCII)

MAX_BYTES = 1 << 30  # of all arrays together
MAX_OBJECTS = 1000  # a large artifact has a hundred
MAX_CHUNKS = 4000
MAX_ATTRIBUTES = 16  # of one object
MAX_ATTRIBUTE_BYTES = 1 << 12
PLAUSIBLE_BYTES = 48 << 20  # allowed for a file of any size
PLAUSIBLE_RATIO = 3  # unpacked over stored bytes, beyond that

_TEXT = (h5py.h5t.CSET_UTF8, h5py.h5t.STR_NULLPAD)  # of the attributes that the store writes
_FILTERS = (h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32)


def inspect(file: h5py.File, stored: int) -> dict[str, h5py.Dataset]:
    """Walk the whole file without following any link.

    Args:
        file: an open file.
        stored: its size, bytes.

    Returns:
        Its datasets by path; now they are safe to read.

    Raises:
        ValueError: something in it is refused.
    """
    datasets = _walk(file)
    declared, limit = sum(_declared(path, dataset) for path, dataset in datasets.items()), plausible_total(stored)
    if declared > limit:
        raise ValueError(f"it declares {declared} bytes of data in {stored} stored, at most {limit} are read")
    if sum(dataset.id.get_storage_size() for dataset in datasets.values()) > stored:
        raise ValueError("its datasets share storage")
    chunked = {path: dataset for path, dataset in datasets.items() if dataset.chunks}
    for path, dataset in chunked.items():
        if any(step > max(1, size) for step, size in zip(dataset.chunks, dataset.shape, strict=True)):
            raise ValueError(f"{path} has chunks of {dataset.chunks}, larger than its shape {dataset.shape}")
    chunks = sum(map(_chunk_count, chunked.values()))
    if chunks > MAX_CHUNKS:
        raise ValueError(f"it has {chunks} chunks, at most {MAX_CHUNKS} are read")
    if (
        sum(_chunk_count(dataset) * _chunk_bytes(dataset) for dataset in chunked.values()) > 2 * limit
    ):  # the last ones may be partly outside
        raise ValueError(f"its chunks unpack to more than twice the {limit} bytes that are read")
    for path, dataset in datasets.items():
        _check_storage(path, dataset)
    return datasets


def plausible_total(stored: int) -> int:
    """Return how many bytes of data a file of `stored` bytes may unpack to."""
    return min(MAX_BYTES, max(PLAUSIBLE_BYTES, PLAUSIBLE_RATIO * stored))


def _walk(file: h5py.File) -> dict[str, h5py.Dataset]:
    datasets: dict[str, h5py.Dataset] = {}
    root = file["/"]
    seen = {h5py.h5o.get_info(root.id).addr}
    pending: list[tuple[str, Any]] = [("", root)]
    while pending:
        prefix, group = pending.pop()
        if prefix and h5py.h5a.get_num_attrs(group.id):
            raise ValueError(f"the group {prefix} has attributes")
        if len(seen) + len(group) > MAX_OBJECTS:
            raise ValueError(f"it holds more than {MAX_OBJECTS} objects")
        for path, raw in _children(prefix, group):
            info = h5py.h5o.get_info(group.id, raw)
            if info.addr in seen:
                raise ValueError(f"{path} is a second name for something else in the file")
            seen.add(info.addr)
            if info.type == h5py.h5o.TYPE_GROUP:
                pending.append((f"{path}/", group[raw]))
            elif info.type == h5py.h5o.TYPE_DATASET:
                datasets[path] = group[raw]
            else:
                raise ValueError(f"{path} is neither a group nor a dataset")
    return datasets


def _children(prefix: str, group: h5py.Group) -> list[tuple[str, bytes]]:
    """Return paths and raw names below a group; every entry must be plain with an ordinary name."""
    children = []
    links = group.id.links
    for raw in group.id:
        path = prefix + raw.decode("utf-8")
        if not PATH.fullmatch(path):
            raise ValueError(f"{path!r} is not a path the store uses")
        if links.get_info(raw).type != h5py.h5l.TYPE_HARD:
            raise ValueError(f"{path} is a link")
        children.append((path, raw))
    return children


def read_attributes(path: str, item: Any) -> dict[str, str | int]:
    """Return all attributes of an object, which must be of the two types that the store writes.

    Raises:
        ValueError: one of them is not.
    """
    count = h5py.h5a.get_num_attrs(item.id)
    if count > MAX_ATTRIBUTES:
        raise ValueError(f"{path} has {count} attributes, at most {MAX_ATTRIBUTES} are read")
    attributes = (h5py.h5a.open(item.id, index=index) for index in range(count))
    return {each.name.decode("utf-8"): _attribute_value(path, item, each) for each in attributes}


def _attribute_value(path: str, item: Any, attribute: Any) -> str | int:
    name, kind = attribute.name.decode("utf-8"), attribute.get_type()
    label = f"attribute {name!r} of {path}"
    if attribute.get_space().get_simple_extent_type() != h5py.h5s.SCALAR or kind.get_size() > MAX_ATTRIBUTE_BYTES:
        raise ValueError(f"{label} is not a single value, or a too long one")
    if isinstance(kind, h5py.h5t.TypeIntegerID) and kind == h5py.h5t.STD_I64LE:
        return int(item.attrs[name])
    text = isinstance(kind, h5py.h5t.TypeStringID) and not kind.is_variable_str()
    if not text or (kind.get_cset(), kind.get_strpad()) != _TEXT:
        raise ValueError(f"{label} is neither a signed integer of 64 bits nor a text of fixed length in UTF-8")
    value = item.attrs[name]
    data = value if isinstance(value, bytes) else str(value).encode()
    if kind.get_size() != max(1, len(data)):
        raise ValueError(f"{label} is padded")
    return data.decode("utf-8")


def _declared(path: str, dataset: h5py.Dataset) -> int:
    """Return the bytes that a dataset takes in memory, if it is of an allowed type."""
    creation = dataset.id.get_create_plist()
    if creation.get_layout() == h5py.h5d.VIRTUAL:
        raise ValueError(f"{path} is a virtual dataset")
    if creation.get_external_count():
        raise ValueError(f"{path} keeps its data in another file")
    space = dataset.id.get_space()
    simple = space.get_simple_extent_type() in (h5py.h5s.SCALAR, h5py.h5s.SIMPLE)
    if not simple or dataset.maxshape != dataset.shape:
        raise ValueError(f"{path} has no fixed shape")
    kind = dataset.id.get_type()
    if not isinstance(kind, h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID | h5py.h5t.TypeEnumID):
        raise ValueError(f"{path} holds neither integers, floats nor booleans")
    if dataset.dtype.str not in DTYPES or (isinstance(kind, h5py.h5t.TypeEnumID) and dataset.dtype != np.bool_):
        raise ValueError(f"{path} has the type {dataset.dtype}, which the store does not use")
    return int(math.prod(dataset.shape) * dataset.dtype.itemsize)


def _chunk_count(dataset: h5py.Dataset) -> int:
    return int(math.prod(-(-size // step) for size, step in zip(dataset.shape, dataset.chunks, strict=True)))


def _chunk_bytes(dataset: h5py.Dataset) -> int:
    return int(math.prod(dataset.chunks) * dataset.dtype.itemsize)


def _check_storage(path: str, dataset: h5py.Dataset) -> None:
    """Check that all declared data is stored, and that compressed chunks unpack to their exact size."""
    creation = dataset.id.get_create_plist()
    filters = [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]
    if filters != [code for code in _FILTERS if code in filters]:
        raise ValueError(f"{path} is packed in a way the store does not use")
    if not dataset.chunks:
        if dataset.id.get_storage_size() != _declared(path, dataset):
            raise ValueError(f"{path} declares data that is not stored")
        return
    chunks: list[Any] = []
    dataset.id.chunk_iter(chunks.append)
    if len(chunks) != _chunk_count(dataset):
        raise ValueError(f"{path} declares data that is not stored")
    if h5py.h5z.FILTER_DEFLATE in filters:
        size = _chunk_bytes(dataset)
        checksum = 4 if h5py.h5z.FILTER_FLETCHER32 in filters else 0
        for chunk in chunks:
            packed = dataset.id.read_direct_chunk(chunk.chunk_offset)[1]
            if chunk.filter_mask or not _unpacks_to(size, packed[: len(packed) - checksum]):
                raise ValueError(f"{path} does not unpack to what it declares")


def _unpacks_to(size: int, packed: bytes) -> bool:
    unpacker = zlib.decompressobj()
    total = 0
    while not unpacker.eof and total <= size:
        piece = unpacker.decompress(packed, 1 << 20)
        if not piece and not packed:
            return False
        total += len(piece)
        packed = unpacker.unconsumed_tail
    return unpacker.eof and total == size and not unpacker.unused_data
