"""What runs the cells of a sweep is given, on this machine and on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from skillcli.progress import OnProgress
from skillcli.sweeps.cell import Cell, OnOutcome, Outcome, Pulse
from skillcli.sweeps.local import LocalPool

WorkIn = Callable[[str, Cell, int, OnProgress], Outcome]
"""Runs a cell in the store of a folder, with so many threads; says how far it is."""


@dataclass(frozen=True)
class Run:
    """What a backend needs.

    Attributes:
        work: runs one cell; importable by its name.
        root: the store's folder.
        jobs: how many cells at a time.
        on_outcome: called with the outcome of every cell.
        on_beat: called while cells run; returns whether the cell shall go on.
        stopping: returns whether to stop.
    """

    work: WorkIn
    root: Path
    jobs: int
    on_outcome: OnOutcome
    on_beat: Pulse
    stopping: Callable[[], bool]


Backend = Callable[[Run, Iterator[Cell]], None]
"""Runs cells, and tells of their outcomes and signs of life."""


def run_locally(run: Run, cells: Iterator[Cell]) -> None:
    """Run cells in processes of this machine."""
    work = partial(run.work, str(run.root.absolute()))
    LocalPool(work, run.jobs, run.on_outcome, run.on_beat, run.stopping).run(cells)
