"""Compare two artifacts and show only the differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from skillcli.store import Artifact

Pairs = dict[str, tuple[Any, Any]]  # by key, the two values; None if one is missing


def differences(a: Artifact, b: Artifact) -> dict[str, Pairs]:
    """Return the differences in origin, recipe, packages, results and arrays, by part and key."""
    return {
        "origin": _differing(_origin(a), _origin(b)),
        "recipe": _differing(dict(_flat(a.recipe)), dict(_flat(b.recipe))),
        "packages": _differing(a.packages, b.packages),
        "results": _differing(dict(_flat(a.results)), dict(_flat(b.results))),
        "arrays": _arrays(a.arrays, b.arrays),
    }


def _origin(one: Artifact) -> dict[str, Any]:
    parents = ", ".join(parent.content_sha256[:12] for parent in one.parents)
    commit = one.git_commit[:12] + (" with changes" if one.git_dirty else "")
    return {"kind": one.kind, "seed": one.seed, "model": one.model_sha256[:12], "git": commit, "parents": parents}


def _differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> Pairs:
    keys = [*a, *(key for key in b if key not in a)]
    return {key: (a.get(key), b.get(key)) for key in keys if a.get(key) != b.get(key)}


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested JSON by dotted path; list entries with a name are identified by it."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for index, item in enumerate(value):
            label = item.get("name", index) if isinstance(item, Mapping) else index
            yield from _flat(item, f"{path}[{label}]")
    else:
        yield path, value


def _arrays(a: Mapping[str, Any], b: Mapping[str, Any]) -> Pairs:
    """Return the arrays that differ: types and shapes, or if these agree, the size of the difference."""
    found: Pairs = {}
    for path in sorted({*a, *b}):
        left, right = a.get(path), b.get(path)
        if left is None or right is None or left.dtype != right.dtype or left.shape != right.shape:
            found[path] = (_label(left), _label(right))
        elif not np.array_equal(left, right, equal_nan=left.dtype.kind == "f"):
            found[path] = (_label(left), _apart(left.astype(float), right.astype(float)))
    return found


def _apart(left: Any, right: Any) -> str:
    with np.errstate(invalid="ignore", over="ignore"):  # curves may hold infinities
        apart = np.abs(left - right)
    known = apart[np.isfinite(apart)]
    if not known.any():
        return "differs in what is missing or infinite"
    return f"differs by up to {known.max():.3g}, on average {known.mean():.3g}"


def _label(array: Any) -> str | None:
    return None if array is None else f"{array.dtype} {array.shape}"
