"""`KindSpec`: schema, parents, arrays, results and checks of a kind of artifact."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skillcli.errors import StoreError
from skillcli.kinds.record import Measured, Record

Array = NDArray[Any]
Arrays = dict[str, Array]
Results = dict[str, Any]
Sizes = Mapping[str, int]
Step = Callable[[Arrays, Results], tuple[Arrays, Results]]
R = TypeVar("R", bound=Record)
M = TypeVar("M", bound=Measured)


class Stored(Protocol):
    """What a kind needs of an artifact."""

    @property
    def id(self) -> object:
        """Its id."""

    @property
    def kind(self) -> str:
        """The name of its kind."""

    @property
    def results(self) -> Mapping[str, Any]:
        """Results, as JSON."""

    @property
    def measured(self) -> Mapping[str, Any]:
        """Values that differ between equal runs, as JSON."""


LARGEST = 1e12  # largest value: metres, radians, seconds, rewards
LARGEST_OF_CURVE = 1e100  # single precision ends far below, and a picture of it can still be computed


@dataclass(frozen=True)
class Values:
    """Valid values of an array: its type ("f" floats, "i" signed integers, "b" booleans) and range.

    Floats must be finite; where `gaps` allows it, some may be NaN or infinite.
    """

    kind: str = "f"
    low: float = -LARGEST
    high: float = LARGEST
    of: str = ""  # a dimension, as `sizes` names it, whose size bounds the values
    margin: int = 0  # the largest value is the size minus this
    gaps: bool = False


def index(of: str, *, none: bool = False) -> Values:
    """Declare positions along a dimension; -1 for none, if allowed."""
    return Values("i", -1 if none else 0, of=of, margin=1)


NUMBER = Values()
POSITIVE = Values(low=1e-30)
WEIGHT = Values(low=-float("inf"), high=float("inf"))
CURVE = Values(low=-LARGEST_OF_CURVE, high=LARGEST_OF_CURVE, gaps=True)
TRUTH = Values("b")
COUNT = Values("i", 0)


@dataclass(frozen=True)
class Field:
    """One array, or the arrays that fit one pattern."""

    dimensions: str  # comma separated
    unit: str = ""
    required: bool = True
    values: Values = NUMBER


def nothing_more(_arrays: Mapping[str, Array], _results: Mapping[str, Any], _sizes: Sizes) -> Iterator[str]:
    """Check nothing, for a kind without rules beyond types, ranges and shapes."""
    yield from ()


@dataclass(frozen=True, kw_only=True)
class KindSpec(Generic[R, M]):
    """A kind of artifact.

    Attributes:
        name: of the kind and of the stage that writes it; the second part of an id.
        version: of its schema.
        fields: its arrays by pattern, more special patterns first.
        results: type of the results; part of the content hash.
        measured: type of the values that differ between equal runs, such as seconds.
        made_from: allowed kinds of its one parent, the usual one first; empty if it has no parent.
        check: yields contradictions in arrays, results and sizes that have valid types, one line each.
        migrations: from a version of the schema to a function that leads to the next.
    """

    name: str
    version: int
    fields: Mapping[str, Field]
    results: type[R]
    measured: type[M]
    made_from: tuple[str, ...] = ()
    check: Callable[[Mapping[str, Array], Mapping[str, Any], Sizes], Iterator[str]] = nothing_more
    migrations: Mapping[int, Step] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return the name."""
        return self.name

    def holds(self, folder: str) -> bool:
        """Return whether every artifact of this kind has arrays in a folder, such as "weights"."""
        return any(pattern.startswith(f"{folder}/") and each.required for pattern, each in self.fields.items())

    def is_kind_of(self, artifact: Stored) -> bool:
        """Return whether an artifact is of this kind."""
        return artifact.kind == self.name

    def results_of(self, artifact: Stored) -> R:
        """Return the results of an artifact of this kind.

        Raises:
            StoreError: it is of another kind.
        """
        self._refuse_others(artifact)
        return self.results.read(artifact.results)

    def measured_of(self, artifact: Stored) -> M:
        """Return the measured values of an artifact of this kind.

        Raises:
            StoreError: it is of another kind.
        """
        self._refuse_others(artifact)
        return self.measured.read(artifact.measured)

    def _refuse_others(self, artifact: Stored) -> None:
        if not self.is_kind_of(artifact):
            raise StoreError(f"{artifact.id} is of kind {artifact.kind}, expected {self.name}", "give another one")


def counted(what: str, found: list[Any], wanted: int) -> Iterator[str]:
    """Report a list of the wrong length."""
    if len(found) != wanted:
        yield f"{what} has {len(found)} entries, expected {wanted}"


def divided(arrays: Mapping[str, Array], path: str, parts: int) -> bool:
    """Return whether an array of indices names each of so many parts, in order."""
    return np.array_equal(np.unique(arrays[path]), np.arange(parts)) and not (np.diff(arrays[path]) < 0).any()


def all_or_none(arrays: Mapping[str, Array], *paths: str) -> Iterator[str]:
    """Report arrays that are missing beside others that belong to them."""
    there = [path for path in paths if path in arrays]
    lacking = [path for path in paths if path not in arrays]
    if there and lacking:
        yield f"{there[0]} is there without {', '.join(lacking)}"


def different(arrays: Mapping[str, Array], path: str) -> Iterator[str]:
    """Report pairs of one and the same."""
    pair = arrays.get(path)
    if pair is not None and (pair[:, 0] == pair[:, 1]).any():
        yield f"{path} names a pair of one and the same"
