"""Run cells in processes of this machine: a fixed number of them, with the cores divided between them."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from skillcli.sweeps.cell import FAILED, PRUNED, STOPPED, Beat, Cell, OnOutcome, Outcome, Pulse
from skillcli.sweeps.worker import Work, serve

TRIES = 2  # of a cell whose process dies
POLL_SECONDS = 0.2
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # read when numpy and torch are loaded


def available_cores() -> tuple[int, ...]:
    """Return the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))


def divide(cores: tuple[int, ...], jobs: int) -> list[tuple[int, ...]]:
    """Divide cores among workers, as evenly as possible; with more workers than cores, several share one."""
    if jobs >= len(cores):
        return [(cores[k % len(cores)],) for k in range(jobs)]
    return [cores[k * len(cores) // jobs : (k + 1) * len(cores) // jobs] for k in range(jobs)]


@dataclass(eq=False)
class _Worker:
    process: SpawnProcess
    connection: Connection
    cores: tuple[int, ...]
    cell: Cell | None = None
    pruned: bool = False


@dataclass
class LocalPool:
    """Worker processes.

    Args:
        work: runs a cell; must be importable by its name.
        jobs: how many processes.
        on_outcome: called with the outcome of every cell.
        on_beat: called while cells run; returns whether the cell shall go on.
        stopping: returns whether to stop: running cells save what they have, no more begin.
    """

    work: Work
    jobs: int
    on_outcome: OnOutcome
    on_beat: Pulse
    stopping: Callable[[], bool]
    _workers: list[_Worker] = field(default_factory=list)
    _shares: deque[tuple[int, ...]] = field(default_factory=deque)  # cores that no worker has
    _again: deque[Cell] = field(default_factory=deque)
    _deaths: dict[int, int] = field(default_factory=dict)

    def run(self, cells: Iterator[Cell]) -> None:
        """Run all cells; after a request to stop, wait until the running ones have saved."""
        asked = False
        self._shares.extend(divide(available_cores(), self.jobs))
        try:
            while True:
                if self.stopping() and not asked:
                    asked = True
                    for worker in self._workers:
                        self._ask_to_stop(worker)
                if not asked:
                    self._hand_out(cells)
                if any(worker.cell for worker in self._workers):
                    self._listen()
                elif asked or not self._again:
                    return
        finally:
            self._end()

    def _hand_out(self, cells: Iterator[Cell]) -> None:
        """Give every idle worker a cell; start no more workers than there are cells for."""
        idle = [worker for worker in self._workers if worker.cell is None]
        while idle or self._shares:
            cell = self._again.popleft() if self._again else next(cells, None)
            if cell is None:
                return
            self._give(idle.pop() if idle else self._start(self._shares.popleft()), cell)

    def _give(self, worker: _Worker, cell: Cell) -> None:
        worker.cell, worker.pruned = cell, False
        with suppress(OSError):  # it has died: `_listen` sees it
            worker.connection.send(cell)

    def _start(self, cores: tuple[int, ...]) -> _Worker:
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, self.work, cores, len(cores)), daemon=False)
        with _environment(dict.fromkeys(THREADS, str(len(cores)))):
            process.start()
        theirs.close()
        worker = _Worker(process, ours, cores)
        self._workers.append(worker)
        return worker

    def _listen(self) -> None:
        waiting = {worker.connection: worker for worker in self._workers}
        for ready in connection.wait(list(waiting), POLL_SECONDS):
            worker = waiting[ready]  # type: ignore[index]
            try:
                message = worker.connection.recv()
            except (EOFError, OSError):
                self._died(worker)
                continue
            if isinstance(message, Beat):
                if not self.on_beat(message) and not worker.pruned:
                    worker.pruned = True
                    self._ask_to_stop(worker)
            else:
                worker.cell = None
                self._conclude(worker, message)

    def _conclude(self, worker: _Worker, outcome: Outcome) -> None:
        if worker.pruned and outcome.state == STOPPED:
            outcome = Outcome(outcome.index, PRUNED)
        self.on_outcome(outcome)

    def _died(self, worker: _Worker) -> None:
        """Clear a worker that died; its cell is tried once more."""
        worker.process.join()
        worker.connection.close()
        self._workers.remove(worker)
        self._shares.append(worker.cores)
        if (cell := worker.cell) is None:
            return
        code = worker.process.exitcode or 0
        if self.stopping():
            self.on_outcome(Outcome(cell.index, STOPPED))
            return
        self._deaths[cell.index] = self._deaths.get(cell.index, 0) + 1
        if self._deaths[cell.index] < TRIES:
            self._again.append(cell)
            return
        why = f"signal {-code} ({signal.strsignal(-code)})" if code < 0 else f"exit code {code}"
        self.on_outcome(Outcome(cell.index, FAILED, message=f"its process ended {TRIES} times, at last by {why}"))

    @staticmethod
    def _ask_to_stop(worker: _Worker) -> None:
        if worker.cell is not None and worker.process.pid:
            with suppress(ProcessLookupError):
                os.kill(worker.process.pid, signal.SIGTERM)

    def _end(self) -> None:
        """End every worker: idle ones at once; those that are busy although nobody waits any more are killed."""
        for worker in self._workers:
            if worker.cell is not None:
                worker.process.kill()
            else:
                with suppress(OSError):
                    worker.connection.send(None)
        for worker in self._workers:
            worker.process.join()
            worker.connection.close()
        self._workers.clear()


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that start inside the block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
