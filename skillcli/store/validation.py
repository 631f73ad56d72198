"""Check the values of an artifact: types, ranges and counts, beyond the shapes of its arrays.

A file with correct hashes may still hold infinite goals or an unknown skill. Everything that reads artifacts relies on
these checks. Checks that need the recipe are in `skillcli.evaluation.consistency`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain, islice
from typing import Any

import numpy as np

from skillcli.kinds import KINDS
from skillcli.kinds.spec import Values
from skillcli.store import schema
from skillcli.store.artifact import Array, Artifact
from skillcli.store.migrate import brought_up
from skillcli.store.results import complaints
from skillcli.trajectories import SAFETY_LIMITS

_NOTED = 20  # problems to report at most


def checked(artifact: Artifact) -> Artifact:
    """Return the artifact if it is valid, in whatever schema.

    Raises:
        StoreError: it holds invalid values.
    """
    arrays, results = brought_up(artifact)
    label = str(artifact.id)
    schema.check_arrays(artifact.kind, {path: array.shape for path, array in arrays.items()}, label)
    schema.refuse(list(islice(_problems(artifact, arrays, results), _NOTED)), label)
    return artifact


def _problems(artifact: Artifact, arrays: Mapping[str, Array], results: Mapping[str, Any]) -> Iterator[str]:
    kind, found = artifact.kind, False
    sizes = schema.sizes(kind, {path: array.shape for path, array in arrays.items()})
    for problem in chain(_empty(sizes), complaints(kind, results, artifact.measured), _values(kind, arrays, sizes)):
        found = True
        yield problem
    if not found:  # the following checks rely on this one
        if KINDS[kind].holds("trajectories"):
            yield from _clock(arrays["trajectories/time"])
            yield from _counted(arrays.get("trajectories/violated"), arrays.get("trajectories/violations"))
        if any(curve.size == 0 for path, curve in arrays.items() if path.startswith("curves/")):
            yield "a curve has no points"
        yield from KINDS[kind].check(arrays, results, sizes)


def _empty(sizes: Mapping[str, int]) -> Iterator[str]:
    for name in ("skill", "latent", "trajectories: episode", "trajectories: step", "trajectories: action"):
        if sizes.get(name) == 0:
            yield f"it has no {name.removeprefix('trajectories: ')}"
    if sizes.get("trajectories: limit", 0) > len(SAFETY_LIMITS):
        yield f"trajectories/violations counts {sizes['trajectories: limit']} limits, there are {len(SAFETY_LIMITS)}"


def _values(kind: str, arrays: Mapping[str, Array], sizes: Mapping[str, int]) -> Iterator[str]:
    for path, array in arrays.items():
        values = schema.values_of(kind, path)
        if not _is_of(array, values.kind):
            yield f"{path} holds {array.dtype}, expected {_KINDS[values.kind]}"
        elif values.kind != "b" and array.size:
            yield from _out_of_range(path, array, values, sizes)


_KINDS = {"f": "floats of 32 or 64 bits", "i": "integers of 32 or 64 bits", "b": "booleans"}


def _is_of(array: Array, kind: str) -> bool:
    return array.dtype.kind == kind and (kind == "b" or array.dtype.itemsize in (4, 8))


def _out_of_range(path: str, array: Array, values: Values, sizes: Mapping[str, int]) -> Iterator[str]:
    if values.gaps:
        known = np.isfinite(array)
        low, high = array.min(where=known, initial=np.inf), array.max(where=known, initial=-np.inf)
        if low > high:  # none is finite
            return
    else:
        low, high = array.min(), array.max()  # NaN where there is one
    low, high = low.item(), high.item()  # in double precision, which all bounds fit in
    if not (np.isfinite(low) and np.isfinite(high)):
        yield f"{path} holds values that are not finite"
        return
    largest = sizes[values.of] - values.margin if values.of in sizes else values.high
    if low < values.low or high > largest:
        yield f"{path} reaches from {low:g} to {high:g}, allowed is {values.low:g} to {largest:g}"


def _counted(violated: Array | None, violations: Array | None) -> Iterator[str]:
    if violated is not None and (violations is None or (violated.sum(axis=1) != violations).any()):
        yield "trajectories/violations does not count the control steps of trajectories/violated"


def _clock(time: Array) -> Iterator[str]:
    if time[0] != 0 or not (np.diff(time) > 0).all():
        yield "trajectories/time does not begin at 0 and grow"
