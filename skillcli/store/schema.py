"""Check arrays against their kind: a pattern for each array with its dimensions, its unit, and whether it is required.

In a pattern, `*` stands for one name and `**` for any path below. Dimensions are named; within a folder the same name
means the same size, and `step+1` is one more than `step`. `...` stands for any further dimensions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import PurePosixPath

from skillcli import __version__
from skillcli.errors import StoreError
from skillcli.kinds import KINDS, AnyKind
from skillcli.kinds.arrays import POSITIONS
from skillcli.kinds.spec import CURVE, Field, Values

Shape = tuple[int, ...]

FIXED = {"xyz": 3, "xy": 2, "pose": 7, "bound": 2, "member": 2}
SHARED = {"skill", "latent"}  # mean the same in every folder of a file
FREE = {"iteration"}  # every curve may have its own length


def check_parents(kind: str, parents: Sequence[str], label: str) -> None:
    """Refuse parents that do not fit this kind; `parents` are their kinds.

    Raises:
        StoreError: there are too many or too few, or one is of another kind.
    """
    wanted = KINDS[kind].made_from
    if len(parents) != (1 if wanted else 0) or not set(parents) <= set(wanted):
        expected = f"one of kind {' or '.join(wanted)}" if wanted else "none"
        found = f"{len(parents)} parents" if len(parents) > 1 else f"one of kind {parents[0]}" if parents else "none"
        raise StoreError(f"{label} needs as its parent {expected}, got {found}", "it was not made by skill")


def is_older(kind: str, version: int) -> bool:
    """Return whether an artifact must be migrated before use."""
    return version < KINDS[kind].version


def check_not_newer(kind: str, version: int, label: str) -> None:
    """Refuse an artifact of a newer `skill`.

    Raises:
        StoreError: its schema is newer than ours.
    """
    ours = KINDS[kind].version
    if version > ours:
        raise StoreError(
            f"{label} has schema {version}, skill {__version__} reads at most {ours}",
            f"install a newer skill: `pip install --upgrade skillcli` (more than {__version__})",
        )


def check_arrays(kind: str, shapes: Mapping[str, Shape], label: str) -> None:
    """Compare the arrays of an artifact with its kind.

    Raises:
        StoreError: a required array is missing, a path is unknown, or sizes of dimensions disagree.
    """
    fields = KINDS[kind].fields
    problems = _missing(KINDS[kind], shapes)
    found: dict[str, tuple[int, str]] = {}
    for path, shape in sorted(shapes.items()):
        field = _field(fields, path)
        if field is None:
            known = ", ".join(sorted({pattern.split("/")[0] for pattern in fields}))
            problems.append(f"unknown array {path} (known folders: {known})")
        else:
            problems += _disagreements(path, shape, field.dimensions, found)
    refuse(problems, label)


def refuse(problems: Sequence[str], label: str) -> None:
    """Raise an error with the first few problems of an artifact, if there are any.

    Raises:
        StoreError: there are.
    """
    if problems:
        more = f" and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise StoreError(f"{label}: {'; '.join(problems[:3])}{more}", "skillcli/kinds lists what it holds")


def sizes(kind: str, shapes: Mapping[str, Shape]) -> dict[str, int]:
    """Return the sizes of the named dimensions of valid arrays: "skill", "trajectories: step"."""
    found: dict[str, tuple[int, str]] = {}
    for path, shape in sorted(shapes.items()):
        if field := _field(KINDS[kind].fields, path):
            _disagreements(path, shape, field.dimensions, found)
    return {name: size for name, (size, _) in found.items()}


def values_of(kind: str, path: str) -> Values:
    """Return the range of values of the array at a path."""
    field = _field(KINDS[kind].fields, path)
    return field.values if field else CURVE


def labels(kind: str, path: str, ndim: int) -> tuple[str, str]:
    """Return dimension names, comma separated, and the unit of one array; dimensions without a name are called axisN."""
    field = _field(KINDS[kind].fields, path) or Field("...")
    names = [name for name in field.dimensions.split(",") if name != "..."]
    return ",".join(names + [f"axis{i}" for i in range(len(names), ndim)]), field.unit


def _field(fields: Mapping[str, Field], path: str) -> Field | None:
    return next((field for pattern, field in fields.items() if _matches(pattern, path)), None)


def _matches(pattern: str, path: str) -> bool:
    return _expression(pattern).fullmatch(path) is not None


@cache
def _expression(pattern: str) -> re.Pattern[str]:
    return re.compile(re.escape(pattern).replace(r"\*\*", ".+").replace(r"\*", "[^/]+"))


def _missing(spec: AnyKind, shapes: Mapping[str, Shape]) -> list[str]:
    wanted = [pattern for pattern, field in spec.fields.items() if field.required]
    lacking = [f"{pattern} is missing" for pattern in wanted if not any(_matches(pattern, path) for path in shapes)]
    if spec.holds("trajectories") and not POSITIONS.keys() & shapes.keys():
        lacking.append(f"one of {', '.join(POSITIONS)} is needed")
    return lacking


def _disagreements(path: str, shape: Shape, dimensions: str, sizes: dict[str, tuple[int, str]]) -> list[str]:
    """List where an array contradicts the sizes of dimensions so far; its new names join `sizes`."""
    names = dimensions.split(",")
    if names[-1] == "...":
        names = names[:-1]
        fits = len(shape) >= len(names)
    else:
        fits = len(shape) == len(names)
    if not fits:
        return [f"{path} must be ({dimensions}), got shape {shape}"]
    problems = []
    for name, size in zip(names, shape, strict=False):
        base, offset = (name[:-2], 1) if name.endswith("+1") else (name, 0)
        key = base if base in SHARED or base in FIXED else f"{PurePosixPath(path).parent}: {base}"
        if base in FREE:
            continue
        expected, source = sizes.setdefault(key, (FIXED.get(base, size - offset), path))
        if size != expected + offset:
            because = "" if base in FIXED else f" by {source}"
            problems.append(f"{path} has {name} = {size}, expected {expected + offset}{because}")
    return problems
