"""A sweep: many runs of one recipe, over seeds and settings, each an artifact of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli.kinds.record import Measured, Record, optional
from skillcli.kinds.spec import CURVE, Array, Field, KindSpec, Sizes, Values, counted

MAX_FAILURES = 200  # told with their line; all of them are marked in the arrays
WORDS = 8  # a SHA-256 as whole numbers of 32 bits
FAILED, DONE, PRUNED = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class SweepSetting(Record):
    """One combination of values."""

    label: str
    values: Mapping[str, str]  # by key, as typed


@dataclass(frozen=True, kw_only=True)
class SweepFailure(Record):
    """A cell without a result, and why."""

    setting: int
    seed: int
    message: str


@dataclass(frozen=True, kw_only=True)
class SweepResults(Record):
    """What was run. How well each cell did stands in the arrays below `metrics`."""

    through: str  # the last stage of each cell
    settings: tuple[SweepSetting, ...]
    cells: int
    failed: int
    pruned: int = optional(0)  # stopped early by a search of settings
    failures: tuple[SweepFailure, ...] = optional(())  # the first of them


@dataclass(frozen=True, kw_only=True)
class SweepMeasured(Measured):
    """What the sweep cost this time."""

    wall_seconds: float
    reused: int  # cells that were there already
    jobs: int
    where: str  # local or ray


def sha_words(sha256: str) -> list[int]:
    """Return a SHA-256 as eight whole numbers; of no hash, zeros."""
    return [int(sha256[i : i + 8] or "0", 16) for i in range(0, 8 * WORDS, 8)]


def sha_text(words: Array) -> str:
    """Return the 64 hexadecimal digits of eight whole numbers."""
    return "".join(f"{int(word):08x}" for word in words)


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    state, settings = arrays["cells/state"], results["settings"]
    yield from counted("cells/state", list(state), results["cells"])
    for name, value in (("failed", FAILED), ("pruned", PRUNED)):
        if results.get(name, 0) != (found := int((state == value).sum())):
            yield f"results.{name} is {results.get(name, 0)}, {found} cells are"
    if len(state) and int(arrays["cells/setting"].max()) >= len(settings):
        yield f"cells/setting names setting {int(arrays['cells/setting'].max())}, there are {len(settings)}"
    if arrays["cells/content"].shape[1] != WORDS:
        yield f"cells/content has {arrays['cells/content'].shape[1]} words, expected {WORDS}"
    elif (arrays["cells/content"].any(axis=1) != (state == DONE)).any():
        yield "cells/content does not fit cells/state"
    pairs = np.stack([arrays["cells/setting"], arrays["cells/seed"]], axis=1)
    if len(np.unique(pairs, axis=0)) != len(pairs):
        yield "a cell stands twice"


SWEEP = KindSpec(
    name="sweep",
    version=1,
    fields={
        "cells/setting": Field("cell", values=Values("i", 0)),
        "cells/seed": Field("cell", values=Values("i", 0, 2.0**63)),
        "cells/state": Field("cell", values=Values("i", FAILED, PRUNED)),
        "cells/content": Field("cell,word", values=Values("i", 0, 2.0**32 - 1)),
        "metrics/**": Field("cell", required=False, values=CURVE),
    },
    results=SweepResults,
    measured=SweepMeasured,
    check=_check,
)
