"""What each kind of artifact holds: one line per array with its dimensions, unit, values, and whether it must be there.

A pattern's `*` stands for one name, `**` for any path below. Dimensions are named; within a folder the same name means
the same size, and `step+1` is one more than `step`. `...` stands for any further dimensions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import PurePosixPath

from skillcli import __version__
from skillcli.errors import StoreError

Shape = tuple[int, ...]

LARGEST = 1e12  # of what is measured or drawn: metres, radians, seconds, rewards


@dataclass(frozen=True)
class Values:
    """What an array holds: the kind of its type ("f" floats, "i" signed integers, "b" booleans) and the range.

    Floats are finite unless `gaps` says that some may be missing.
    """

    kind: str = "f"
    low: float = -LARGEST
    high: float = LARGEST
    of: str = ""  # a dimension, as `sizes` names it, whose size bounds the values
    margin: int = 0  # its size minus this is the largest
    gaps: bool = False


def index(of: str, *, none: bool = False) -> Values:
    """Positions along a dimension; -1 for none of them, where that may be."""
    return Values("i", -1 if none else 0, of=of, margin=1)


NUMBER = Values()
POSITIVE = Values(low=1e-30)
WEIGHT = Values(low=-float("inf"), high=float("inf"))
CURVE = Values(low=-float("inf"), high=float("inf"), gaps=True)
TRUTH = Values("b")
COUNT = Values("i", 0)


@dataclass(frozen=True)
class Field:
    """One array, or the arrays that fit one pattern."""

    dimensions: str  # comma separated
    unit: str = ""
    required: bool = True
    values: Values = NUMBER


@dataclass(frozen=True)
class Kind:
    """A kind of artifact.

    Attributes:
        version: of its schema.
        made_from: the kinds that its one parent may have; empty where it has no parent.
        fields: by pattern, the more special pattern first.
    """

    version: int
    fields: Mapping[str, Field]
    made_from: tuple[str, ...] = ()


FIXED = {"xyz": 3, "xy": 2, "pose": 7, "bound": 2, "member": 2}
SHARED = {"skill", "latent"}  # mean the same in every folder of a file
FREE = {"iteration"}  # every curve may have its own pace

POSITIONS = {
    "trajectories/joint_position": Field("episode,step+1,joint", "rad", required=False),
    "trajectories/gripper_position": Field("episode,step+1,xyz", "m", required=False),
    "trajectories/object_pose": Field("episode,step+1,pose", "m", required=False),
    "trajectories/position": Field("episode,step+1,xy", "m", required=False),
}
TRAJECTORIES = {
    "trajectories/time": Field("step+1", "s"),
    "trajectories/latent": Field("episode,step,latent"),
    "trajectories/skill": Field("episode,step", values=index("skill", none=True)),
    "trajectories/action": Field("episode,step,action", "rad or m"),
    "trajectories/reward": Field("episode,step"),
    "trajectories/target": Field("episode,xyz", "m"),
    "trajectories/success": Field("episode", values=TRUTH),
    "trajectories/length": Field("episode", "step", values=Values("i", 1, of="trajectories: step")),
    "trajectories/violations": Field("episode,limit", "step", required=False, values=COUNT),
    "trajectories/unstable": Field("episode", required=False, values=TRUTH),
    "trajectories/gave_up": Field("episode", required=False, values=TRUTH),
    "trajectories/judged_position": Field("episode,step+1,xyz", "m", required=False),
    **POSITIONS,
}
EMBEDDING = {
    "embedding/mean": Field("skill,latent"),
    "embedding/std": Field("skill,latent", values=POSITIVE),
    "skills/goal": Field("skill,xyz", "m"),
}

KINDS: Mapping[str, Kind] = {
    "pretrain": Kind(
        1,
        {
            "weights/**": Field("...", values=WEIGHT),
            "curves/**": Field("iteration", values=CURVE),
            "evaluation/final_distance": Field("skill,sample", "m"),
            "evaluation/latent": Field("skill,sample,latent"),
            "evaluation/inferred": Field("skill,sample,latent"),
            **EMBEDDING,
            **TRAJECTORIES,
        },
    ),
    "embed-means": Kind(
        2,
        {
            "embedding/bounds": Field("bound,latent"),
            "embedding/latent_distance": Field("skill,skill"),
            "embedding/goal_distance": Field("skill,skill", "m"),
            "halfway/pair": Field("pair,member", values=index("skill")),
            **EMBEDDING,
            **TRAJECTORIES,
        },
        made_from=("pretrain",),
    ),
    "compose": Kind(
        2,
        {
            "plan/latent": Field("segment,latent"),
            "plan/seconds": Field("segment", "s", values=POSITIVE),
            "plan/skill": Field("segment", values=index("skill", none=True)),
            "plan/route": Field("segment", values=index("trajectories: episode")),
            "plan/latent_end": Field("segment,latent", required=False),
            "waypoints/target": Field("waypoint,xyz", "m"),
            "waypoints/closest": Field("waypoint", "m"),
            "waypoints/route": Field("waypoint", values=index("trajectories: episode")),
            "calibration/pair": Field("pair,member", required=False, values=index("skill")),
            "calibration/share": Field("share", required=False),
            "calibration/end": Field("pair,share,xyz", "m", required=False),
            "robots/*": Field("robot,...", required=False),
            "composer/**": Field("...", required=False, values=WEIGHT),
            "curves/**": Field("iteration", required=False, values=CURVE),
            **TRAJECTORIES,
        },
        made_from=("embed-means", "pretrain"),
    ),
    "transfer-eval": Kind(
        1,
        {
            "domains/*/*": Field("episode,...", required=False),
            "episodes/domain": Field("episode", values=COUNT),
            "episodes/final_distance": Field("episode", "m"),
            "episodes/replay_error": Field("episode", "m", required=False),
            "episodes/return": Field("episode"),
            "episodes/*": Field("episode,...", required=False),
            **TRAJECTORIES,
        },
        made_from=("compose", "embed-means", "pretrain"),
    ),
}


def check_kind(kind: str, label: str) -> None:
    """Refuse a kind that is not in the table; `label` says in the message whose it is.

    Raises:
        StoreError: it is not.
    """
    if kind not in KINDS:
        raise StoreError(f"{label} is of an unknown kind, {kind!r}", f"this skill knows {', '.join(KINDS)}")


def check_parents(kind: str, parents: Sequence[str], label: str) -> None:
    """Refuse parents that no artifact of this kind is made from; `parents` are their kinds.

    Raises:
        StoreError: there are too many or too few, or one is of another kind.
    """
    wanted = KINDS[kind].made_from
    if len(parents) != (1 if wanted else 0) or not set(parents) <= set(wanted):
        expected = f"one of kind {' or '.join(wanted)}" if wanted else "none"
        found = f"{len(parents)} parents" if len(parents) > 1 else f"one of kind {parents[0]}" if parents else "none"
        raise StoreError(f"{label} needs as its parent {expected}, got {found}", "it was not made by skill")


def is_older(kind: str, version: int) -> bool:
    """Whether an artifact must be migrated before it can be used."""
    return version < KINDS[kind].version


def check_not_newer(kind: str, version: int, label: str) -> None:
    """Refuse what only a later `skill` can read.

    Raises:
        StoreError: the schema is newer than ours.
    """
    ours = KINDS[kind].version
    if version > ours:
        raise StoreError(
            f"{label} has schema {version}, skill {__version__} reads at most {ours}",
            f"install a newer skill: `pip install --upgrade skillcli` (more than {__version__})",
        )


def check_arrays(kind: str, shapes: Mapping[str, Shape], label: str) -> None:
    """Compare the arrays of an artifact with the table.

    Raises:
        StoreError: a required array lacks, a path is unknown, or named dimensions do not agree.
    """
    fields = KINDS[kind].fields
    problems = _missing(fields, shapes)
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
    """Say the first few things that are wrong with an artifact, if there are any.

    Raises:
        StoreError: there are.
    """
    if problems:
        more = f" and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise StoreError(f"{label}: {'; '.join(problems[:3])}{more}", "skillcli/store/schema.py lists what it holds")


def sizes(kind: str, shapes: Mapping[str, Shape]) -> dict[str, int]:
    """Sizes of the named dimensions of arrays that fit the table: "skill", "trajectories: step"."""
    found: dict[str, tuple[int, str]] = {}
    for path, shape in sorted(shapes.items()):
        if field := _field(KINDS[kind].fields, path):
            _disagreements(path, shape, field.dimensions, found)
    return {name: size for name, (size, _) in found.items()}


def values_of(kind: str, path: str) -> Values:
    """What the array at a path holds."""
    field = _field(KINDS[kind].fields, path)
    return field.values if field else CURVE


def labels(kind: str, path: str, ndim: int) -> tuple[str, str]:
    """Dimension names, comma separated, and the unit of one array; dimensions without a name are called axisN."""
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


def _missing(fields: Mapping[str, Field], shapes: Mapping[str, Shape]) -> list[str]:
    wanted = [pattern for pattern, field in fields.items() if field.required]
    lacking = [f"{pattern} is missing" for pattern in wanted if not any(_matches(pattern, path) for path in shapes)]
    if not POSITIONS.keys() & shapes.keys():
        lacking.append(f"one of {', '.join(POSITIONS)} is needed")
    return lacking


def _disagreements(path: str, shape: Shape, dimensions: str, sizes: dict[str, tuple[int, str]]) -> list[str]:
    """Where one array contradicts the sizes that earlier ones gave to its dimensions; new names join `sizes`."""
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
