"""Read the HDF5 part of a file: first its structure, then its data."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from skillcli.store.hdf5_safety import inspect, read_attributes

# Errors that h5py, zlib and json raise for damaged or hostile files.
FAULTS = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    zlib.error,
)


@dataclass(frozen=True)
class Listing:
    """Everything in a file but its data."""

    userblock: int  # bytes before the HDF5 part
    attributes: Mapping[str, str | int]  # of the root
    labels: Mapping[str, tuple[str, str]]  # by path: dimension names, unit
    datasets: Mapping[str, h5py.Dataset]  # by path, sorted


def list_contents(file: h5py.File, stored: int) -> Listing:
    """List an open file of `stored` bytes.

    Raises:
        ValueError: something in it is refused; h5py raises other `FAULTS` for damage.
    """
    datasets = inspect(file, stored)
    attributes = read_attributes("/", file["/"])
    labels = {}
    for path in sorted(datasets):
        found = read_attributes(path, datasets[path])
        dimensions, unit = found.get("dimensions"), found.get("unit")
        if len(found) != 2 or not isinstance(dimensions, str) or not isinstance(unit, str):
            raise ValueError(f"{path} must have the attributes dimensions and unit, both text, got {', '.join(sorted(found))}")
        labels[path] = (dimensions, unit)
    return Listing(int(file.userblock_size), attributes, labels, {path: datasets[path] for path in sorted(datasets)})


def read_array(dataset: h5py.Dataset) -> NDArray[Any]:
    """Read the data of one dataset, contiguous."""
    return np.ascontiguousarray(dataset[()]).reshape(dataset.shape)


def first_line(error: BaseException) -> str:
    """Return the message of an error in one line."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)  # str() of a KeyError adds quotes
    return (text.splitlines() or [type(error).__name__])[0]
