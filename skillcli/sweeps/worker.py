"""A worker process: takes cells one after the other, and says what becomes of them."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from types import FrameType

from skillcli.errors import Interrupted, SkillError
from skillcli.plaintext import line
from skillcli.progress import OnProgress, Progress
from skillcli.stopping import answered
from skillcli.sweeps.cell import FAILED, STOPPED, Beat, Cell, Outcome

Work = Callable[[Cell, int, OnProgress], Outcome]
"""Runs a cell with so many threads; says how far it is."""

BEAT_SECONDS = 0.5
GRACE_SECONDS = 30.0
"""How long a worker may save after the sweep itself has died."""


def serve(connection: Connection, work: Work, cores: tuple[int, ...], threads: int) -> None:
    """Run the cells that come through a connection, until None comes or the other end is closed."""
    os.setsid()  # Ctrl-C in the terminal is for the sweep, which then asks every worker to stop
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)
    threading.Thread(target=_follow_to_the_end, daemon=True).start()
    busy = False

    def stop(_: int, __: FrameType | None) -> None:
        if busy:
            raise KeyboardInterrupt

    with answered(stop):
        while True:
            try:
                cell = connection.recv()
            except (EOFError, OSError):
                return
            if cell is None:
                return
            busy = True
            outcome = attempt(work, cell, threads, _telling(connection, cell))
            busy = False
            connection.send(outcome)


def attempt(work: Work, cell: Cell, threads: int, on_progress: OnProgress) -> Outcome:
    """Run a cell; whatever goes wrong becomes an outcome with one line."""
    try:
        return work(cell, threads, on_progress)
    except (Interrupted, KeyboardInterrupt):
        return Outcome(cell.index, STOPPED)
    except SkillError as error:
        return Outcome(cell.index, FAILED, message=line(error.message))
    except Exception as error:
        return Outcome(cell.index, FAILED, message=line(f"{type(error).__name__}: {error}"))


def beat_of(cell: Cell, progress: Progress) -> Beat:
    """Shorten progress to a sign of life."""
    success = sum(progress.success.values()) / len(progress.success) if progress.success else None
    return Beat(cell.index, progress.stage, progress.done / max(1, progress.total), success)


def _telling(connection: Connection, cell: Cell) -> OnProgress:
    last = 0.0

    def on_progress(progress: Progress) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= BEAT_SECONDS or progress.done == progress.total:
            last = now
            connection.send(beat_of(cell, progress))

    return on_progress


def _follow_to_the_end() -> None:
    """Stop when the sweep's own process has died: save first, then leave."""
    if (parent := parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE_SECONDS)
        os._exit(1)
