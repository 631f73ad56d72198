"""A cell of a sweep: one run of a recipe with one seed, told to another process, and what became of it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from skillcli.sweeps.axes import Setting

WAITING, RUNNING, DONE, FAILED, PRUNED, STOPPED = "waiting", "running", "done", "failed", "pruned", "stopped"
LONGEST_LABEL = 36  # characters of a setting in a name


@dataclass(frozen=True)
class Cell:
    """One run."""

    index: int
    setting: int
    seed: int
    name: str  # first part of the ids of its artifacts
    through: str  # its last stage
    recipe: Mapping[str, Any]  # resolved
    command: str  # that makes the same by hand


@dataclass(frozen=True)
class Outcome:
    """What became of a cell."""

    index: int
    state: str
    ids: tuple[str, ...] = ()  # of each stage's artifact
    content_sha256: str = ""  # of the last one
    metrics: Mapping[str, float] = field(default_factory=dict)
    reused: bool = False  # everything was there already
    message: str = ""  # why it failed


@dataclass(frozen=True)
class Beat:
    """A sign of life of a running cell."""

    index: int
    stage: str
    share: float  # of the stage that is done, 0 to 1
    success: float | None = None


OnBeat = Callable[[Beat], None]
OnOutcome = Callable[[Outcome], None]
Pulse = Callable[[Beat], bool]
"""Takes a sign of life; returns whether the cell shall go on."""


def cell_name(sweep: str, setting: Setting, seed: int) -> str:
    """Return the name of a cell's artifacts; `setting` holds what distinguishes it."""
    return ".".join(part for part in (sweep, setting_tag(setting), f"s{seed}") if part)


def setting_tag(setting: Setting) -> str:
    """Return a setting as part of a name: the last words of the keys and their values, or a hash of what does not fit."""
    words = [f"{key.rpartition('.')[2]}-{value}" for key, value in setting]
    tag = "_".join(words)
    plain = all(re.fullmatch(r"[A-Za-z0-9_-]+([.][A-Za-z0-9_-]+)?", word, re.ASCII) for word in words)
    keys = {key.rpartition(".")[2] for key, _ in setting}
    if plain and len(keys) == len(setting) and len(tag) <= LONGEST_LABEL:
        return tag
    return hashlib.sha256(repr(setting).encode()).hexdigest()[:10]


def setting_label(setting: Setting) -> str:
    """Return a setting as people read it."""
    return ", ".join(f"{key}={value}" for key, value in setting)


def cell_label(setting: Setting, seed: int) -> str:
    """Return a cell as people read it."""
    return ", ".join(part for part in (setting_label(setting), f"seed {seed}") if part)


_CELL = re.compile(r"(?P<sweep>.+?)(\.(?P<tag>[A-Za-z0-9_-]+([.][A-Za-z0-9_-]+)*))?\.s[0-9]{1,19}", re.ASCII)


def sweep_of(name: str, sweeps: frozenset[str]) -> str:
    """Return which of these sweeps a name belongs to, as `cell_name` gives it; "" for none."""
    if not _CELL.fullmatch(name):
        return ""
    parts = name.split(".")
    return next((found for n in range(len(parts) - 1, 0, -1) if (found := ".".join(parts[:n])) in sweeps), "")
