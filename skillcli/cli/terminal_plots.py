"""Show parts of an artifact in the terminal: its recipe, its curves as sparklines, its ancestors as a tree."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text
from rich.tree import Tree

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Store

WIDTH, NARROW = 40, 6  # characters of a sparkline, most and least
NUMBER = 9  # characters of a number with four digits

_BARS = "▁▂▃▄▅▆▇█"


def sparkline(values: Any, width: int = WIDTH) -> str:
    """Draw a curve in at most `width` characters, each the mean of its share of the values (n,); a space if none is finite."""
    values = np.asarray(values).ravel()
    parts = np.array_split(values, min(width, max(1, len(values))))
    means = np.array([_mean(part.astype(float)) for part in parts])  # a part at a time: a copy of all would be large
    if not np.isfinite(means).any():
        return " " * len(means)
    low, high = np.nanmin(means), np.nanmax(means)
    scale = (len(_BARS) - 1) / (high - low) if high > low else 0.0
    return "".join(" " if np.isnan(mean) else _BARS[round((mean - low) * scale)] for mean in means)


def _mean(values: Any) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan


def curves(arrays: Mapping[str, Any], width: int) -> Table:
    """List every learning curve: first and last value, and a sparkline, coarser on a narrow terminal."""
    frame = 13
    room = width - frame - 2 * NUMBER - max(map(len, arrays), default=0)
    table = Table("curve", "", "first", "last")
    for name, values in sorted(arrays.items()):
        ends = (f"{values[index]:.4g}" for index in (0, -1)) if values.ndim == 1 and len(values) else ("", "")
        table.add_row(name, sparkline(values, max(NARROW, min(WIDTH, room))), *ends)
    return table


def recipe(resolved: Mapping[str, Any]) -> Table:
    """List every value of a resolved recipe, one line per section."""
    table = Table("recipe", "values")
    for section, values in sorted(resolved.items()):
        shown = ", ".join(f"{key}={value}" for key, value in values.items()) if isinstance(values, Mapping) else str(values)
        table.add_row(section, shown)
    return table


def lineage(store: Store, artifact_id: ArtifactId) -> Tree:
    """Show the ancestors of an artifact as a tree; missing or damaged ones are marked."""
    tree = Tree(Text(str(artifact_id), "bold"))
    pending, seen = [(tree, artifact_id)], {artifact_id}
    while pending:
        branch, one = pending.pop(0)
        for parent in store.header(one).parents:
            try:
                same = store.header(parent.id).content_sha256 == parent.content_sha256
                marks = [(f" {parent.content_sha256[:12]}", "dim"), *([] if same else [(" changed since", "red")])]
                below = branch.add(Text.assemble(str(parent.id), *marks))
                if parent.id not in seen:  # a file made by hand may name itself
                    seen.add(parent.id)
                    pending.append((below, parent.id))
            except StoreError:
                branch.add(Text.assemble(str(parent.id), (" gone or damaged", "red")))
    return tree
