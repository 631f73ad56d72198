"""Run cells as tasks of Ray, on this machine or on a cluster whose nodes may have stores of their own.

A node that sees the sweep's own folder writes there. Any other node runs the cell in a store of its own, the one that its
SKILL_STORE names or else a temporary one, and sends the artifacts back as an export, which is checked and imported like any
file from elsewhere. So nothing is there twice, also where a cell ran twice because a node died.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from skillcli.errors import SkillError
from skillcli.plaintext import line
from skillcli.progress import silent
from skillcli.store import ArtifactId, Store, export, import_file
from skillcli.store.atomic import make_folder, temporary_beside
from skillcli.sweeps.cell import DONE, FAILED, STOPPED, Beat, Cell, Outcome
from skillcli.sweeps.run import Run, WorkIn
from skillcli.sweeps.worker import attempt

LOCAL = "local"
RETRIES = 5  # of a cell whose worker or node is lost
WAIT_SECONDS = 0.2
STOP_SECONDS = 60.0  # for running cells to save
ANSWER_SECONDS = 10.0
THREADS = 1  # of a cell, and cores that it asks for
OBJECT_STORE_BYTES = 200 * 1024 * 1024  # of a Ray that is started here: exports are small
MARK = ".shared-"
"""Prefix of a file in the sweep's store, by which a node knows that it sees the same folder."""

Sealed = tuple[Outcome, bytes]


def run_on_ray(address: str, check: Callable[[Any], None], run: Run, cells: Iterator[Cell]) -> None:
    """Run cells on Ray.

    Args:
        address: of a cluster, `auto` for the one of this machine, or `local` to start one here.
        check: called with every artifact that is imported; may raise to refuse it.
        run: what to do, and whom to tell.
        cells: to run.

    Raises:
        SkillError: Ray is not installed, or does not answer.
    """
    mark = "" if address == LOCAL else f"{MARK}{secrets.token_hex(8)}"
    with redirect_stdout(sys.stderr):  # Ray tells of lost nodes on stdout, which is for results
        _run(address, mark, check, run, cells)


def _run(address: str, mark: str, check: Callable[[Any], None], run: Run, cells: Iterator[Cell]) -> None:
    ray = _connect(address, run.jobs)
    try:
        make_folder(run.root)
        if mark:
            (run.root / mark).touch()
        most = run.jobs if address == LOCAL else 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
        _Tasks(ray, run, mark, check).run(cells, most)
    finally:
        if mark:
            (run.root / mark).unlink(missing_ok=True)
        ray.shutdown()


def _connect(address: str, jobs: int) -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise SkillError("--ray: the package is not installed", "pip install 'skillcli[ray]'") from error
    _check_answers(address)
    here = {"num_cpus": jobs, "include_dashboard": False, "object_store_memory": OBJECT_STORE_BYTES}
    options = here if address == LOCAL else {}
    try:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **options)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        raise SkillError(
            f"--ray {address}: {line(str(error))}", "start a node with `ray start --head`, or leave the address out"
        ) from error
    return ray


def _check_answers(address: str) -> None:
    """Refuse an address at which nothing answers: Ray itself would try for minutes.

    Raises:
        SkillError: nothing does.
    """
    host, _, port = address.rpartition(":")
    if host:
        try:
            socket.create_connection((host, int(port)), timeout=ANSWER_SECONDS).close()
        except (OSError, OverflowError) as error:
            raise SkillError(
                f"--ray {address}: nothing answers there: {error}", "start a node with `ray start --head`"
            ) from error


class _Tasks:
    """The tasks of a sweep that are under way."""

    def __init__(self, ray: Any, run: Run, mark: str, check: Callable[[Any], None]) -> None:
        self._ray, self._run, self._check = ray, run, check
        options = {"num_cpus": THREADS, "max_retries": RETRIES, "scheduling_strategy": "SPREAD"}
        self._task = ray.remote(**options)(partial_cell).remote
        self._given = (run.work, str(run.root.absolute()), mark)
        self._under_way: dict[Any, Cell] = {}

    def run(self, cells: Iterator[Cell], most: int) -> None:
        """Run all cells, at most so many under way; after a request to stop, wait for those that save."""
        while not self._run.stopping():
            while len(self._under_way) < most and (cell := next(cells, None)) is not None:
                self._under_way[self._task(*self._given, cell)] = cell
                self._run.on_beat(Beat(cell.index, "on ray", 0.0))
            if not self._under_way:
                return
            ready, _ = self._ray.wait(list(self._under_way), num_returns=1, timeout=WAIT_SECONDS)
            for reference in ready:
                self._conclude(reference)
        for reference in self._under_way:
            self._ray.cancel(reference)
        self._ray.wait(list(self._under_way), num_returns=len(self._under_way), timeout=STOP_SECONDS)

    def _conclude(self, reference: Any) -> None:
        cell = self._under_way.pop(reference)
        try:
            outcome, sealed = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            outcome, sealed = Outcome(cell.index, FAILED, message=line(f"lost by Ray: {error}")[:300]), b""
        if sealed:
            try:
                outcome = replace(outcome, ids=self._imported(sealed, outcome.ids))
            except SkillError as error:
                outcome = Outcome(cell.index, FAILED, message=line(f"what came back is refused: {error.message}"))
        self._run.on_outcome(outcome)

    def _imported(self, sealed: bytes, ids: tuple[str, ...]) -> tuple[str, ...]:
        """Check and import an export; return the ids that the artifacts have here."""
        with _temporary(self._run.root, sealed) as path:
            found = {str(one.exported): str(one.id) for one in import_file(Store(self._run.root), path, self._check)}
        return tuple(found[one] for one in ids)


@contextmanager
def _temporary(root: Path, data: bytes) -> Iterator[Path]:
    path = temporary_beside(root / "ray.tar")
    try:
        path.write_bytes(data)
        yield path
    finally:
        path.unlink(missing_ok=True)


def partial_cell(work: WorkIn, root: str, mark: str, cell: Cell) -> Sealed:
    """Run one cell on whatever node this is, and seal its artifacts if the sweep does not see them.

    Returns:
        The outcome, and an export of the last artifact with its ancestors; nothing if the store is shared.
    """
    own = os.environ.get("SKILL_STORE", "") if mark else ""
    if not mark or (Path(own or root) / mark).exists():
        return attempt(partial(work, own or root), cell, THREADS, silent), b""
    with suppress(OSError), tempfile.TemporaryDirectory(prefix="skill-ray-") as scratch:
        outcome = attempt(partial(work, own or f"{scratch}/store"), cell, THREADS, silent)
        if outcome.state != DONE:
            return outcome, b""
        path = Path(scratch) / "cell.tar"
        export(Store(Path(own or f"{scratch}/store")), ArtifactId.parse(outcome.ids[-1]), path)
        return outcome, path.read_bytes()
    return Outcome(cell.index, STOPPED), b""
