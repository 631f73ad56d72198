"""What programs give: checked, and put into words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from skillcli.errors import UsageError
from skillcli.trajectories import Array


def numbers(values: Any, what: str, size: int) -> Array:
    """Return an array (n, size) or (size,) of finite numbers.

    Raises:
        UsageError: it has another shape, or holds something else.
    """
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise UsageError(
            f"{what}: expected numbers, got {type(values).__name__}", f"give an array ({size},) or (N, {size})"
        ) from None
    if found.ndim not in (1, 2) or found.shape[-1] != size or not found.size:
        raise UsageError(
            f"{what}: expected the shape ({size},) or (N, {size}), got {found.shape}", "see docs/python.md for shapes"
        )
    if not np.isfinite(found).all():
        raise UsageError(f"{what}: a number is not finite", "give finite numbers")
    return found


def skill_index(skill: str | int, names: Sequence[str]) -> int:
    """Return the index of a skill from its name or index.

    Raises:
        UsageError: there is no such skill.
    """
    if isinstance(skill, str) and skill in names:
        return names.index(skill)
    if not isinstance(skill, str) and 0 <= skill < len(names):
        return int(skill)
    raise UsageError(f"no skill {skill!r}", f"skills: {', '.join(names)}; or an index from 0 to {len(names) - 1}")


def goals(goal: Any) -> tuple[str, list[list[float]]]:
    """Split a goal into the name of a composition, or "", and goals as they are typed.

    Raises:
        UsageError: it is neither a name nor one or several goals.
    """
    if isinstance(goal, str):
        return goal, []
    try:
        found = np.asarray(goal, dtype=float)
    except (TypeError, ValueError):
        raise UsageError(
            f"goal: expected numbers or a name, got {goal!r}", "for example (0.6, 0.0, 0.2), or 'triangle'"
        ) from None
    if found.size == 0:
        return "", []
    if found.ndim not in (1, 2):
        raise UsageError(
            f"goal: expected one goal or several in order, got the shape {found.shape}", "for example (0.6, 0.0, 0.2)"
        )
    listed: list[list[float]] = np.atleast_2d(found).tolist()
    return "", listed


def at_least_one(count: int, what: str) -> int:
    """Return a count.

    Raises:
        UsageError: it is below one.
    """
    if count < 1:
        raise UsageError(f"{what}: expected at least 1, got {count}", "give a larger number")
    return count


def call(function: str, *values: Any, **named: Any) -> str:
    """Write a call as a line of Python, for the record of an artifact; arguments that are None, empty or zero are left out."""
    kept = {name: value for name, value in named.items() if value not in (None, (), [], "", 0, False)}
    written = [*map(repr, values), *(f"{name}={value!r}" for name, value in kept.items())]
    return f"{function}({', '.join(written)})"
