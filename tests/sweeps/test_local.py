"""Cells in processes of this machine, with work that takes no time."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from skillcli.errors import SkillError
from skillcli.progress import OnProgress, Progress
from skillcli.stopping import stoppable
from skillcli.sweeps.cell import Beat, Cell, Outcome
from skillcli.sweeps.local import LocalPool, divide
from skillcli.sweeps.worker import attempt

pytestmark = pytest.mark.slow  # starts processes


def cells(count: int, folder: Path) -> list[Cell]:
    return [Cell(index, 0, index, "name", "pretrain", {"folder": str(folder)}, "command") for index in range(count)]


def working(cell: Cell, threads: int, on_progress: OnProgress) -> Outcome:
    """What a cell does depends on its number."""
    folder = Path(cell.recipe["folder"])
    on_progress(Progress("pretrain", 1, 1, "iterations", success={"1": 0.5}))
    if cell.index == 1:
        raise SkillError("this one cannot\nwork")
    if cell.index == 2 and not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if cell.index == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    assert os.environ["OMP_NUM_THREADS"] == str(threads)
    return Outcome(cell.index, "done", (f"{os.getpid()}", f"{cores}"))


def waiting(cell: Cell, _: int, on_progress: OnProgress) -> Outcome:
    """Work until asked to stop, as a training does, and then save."""
    with stoppable() as stop:
        while not stop.requested:
            on_progress(Progress("pretrain", 1, 2, "iterations"))
            time.sleep(0.02)
    (Path(cell.recipe["folder"]) / f"saved-{cell.index}").touch()
    raise KeyboardInterrupt


def run(
    work: Callable[..., Outcome], asked: list[Cell], on_beat: Callable[[Beat], bool], stop: Callable[[], bool]
) -> dict[int, Outcome]:
    found: dict[int, Outcome] = {}

    def concluded(outcome: Outcome) -> None:
        assert outcome.index not in found, "one outcome each"
        found[outcome.index] = outcome

    LocalPool(work, 2, concluded, on_beat, stop).run(iter(asked))
    return found


def test_failures_and_deaths_are_kept_and_all_others_run(tmp_path: Path) -> None:
    beats: set[int] = set()
    found = run(working, cells(7, tmp_path), lambda beat: beats.add(beat.index) or True, lambda: False)
    assert [found[index].state for index in range(7)] == ["done", "failed", "done", "failed", "done", "done", "done"]
    assert found[1].message == "this one cannot work"
    assert "2 times" in found[3].message and "signal 9" in found[3].message
    assert beats == set(range(7))


def test_a_request_to_stop_lets_running_cells_save_and_starts_no_more(tmp_path: Path) -> None:
    began: set[int] = set()
    found = run(waiting, cells(5, tmp_path), lambda beat: began.add(beat.index) or True, lambda: len(began) == 2)
    assert {outcome.state for outcome in found.values()} == {"stopped"} and len(found) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["saved-0", "saved-1"]


def test_a_cell_that_shall_not_go_on_is_pruned_and_the_worker_takes_the_next(tmp_path: Path) -> None:
    found = run(waiting, cells(4, tmp_path), lambda _: False, lambda: False)
    assert [found[index].state for index in range(4)] == ["pruned"] * 4


def test_cores_are_divided_evenly() -> None:
    assert divide((0, 1), 2) == [(0,), (1,)]
    assert divide((0, 1, 2, 3, 4), 2) == [(0, 1), (2, 3, 4)]
    assert divide((3, 5), 4) == [(3,), (5,), (3,), (5,)]


def test_whatever_goes_wrong_becomes_one_line(tmp_path: Path) -> None:
    def broken(*_: object) -> Outcome:
        raise ValueError("two\nlines")

    found = attempt(broken, cells(1, tmp_path)[0], 1, lambda _: None)
    assert (found.state, found.message) == ("failed", "ValueError: two lines")
