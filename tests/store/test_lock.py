"""The store's lock: exclusive, explained, and never in the way after a crash."""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
import time
from dataclasses import asdict
from pathlib import Path

import pytest

from skillcli.errors import StoreError
from skillcli.store import lock as locking
from skillcli.store import unlock
from skillcli.store.lock import LOCK, Owner, locked, read_owner
from skillcli.store.process import machine, started


def _leave(root: Path, **changes: object) -> None:
    """A lock as a process leaves it."""
    mine = asdict(Owner("t" * 16, "elsewhere", "another machine", os.getpid(), started(os.getpid()), "skill rm x", time.time()))
    root.mkdir(exist_ok=True)
    (root / LOCK).write_text(json.dumps({**mine, **changes}))


def _ended() -> int:
    """The number of a process that has ended."""
    process = multiprocessing.get_context("fork").Process(target=int)
    process.start()
    process.join()
    assert process.pid
    return process.pid


def test_one_at_a_time_whoever_comes(tmp_path: Path) -> None:
    count = 0

    def add() -> None:
        nonlocal count
        for _ in range(20):
            with locked(tmp_path):
                seen = count
                time.sleep(0)
                count = seen + 1

    threads = [threading.Thread(target=add) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert count == 120 and not (tmp_path / LOCK).exists()


def test_the_owner_and_its_age_are_told(tmp_path: Path) -> None:
    _leave(tmp_path, since=time.time() - 40)
    said = rf"locked by process {os.getpid()} on elsewhere since 4\d s \(skill rm x\)"
    with pytest.raises(StoreError, match=said) as caught, locked(tmp_path, patience=0.05):
        pass
    assert "skill unlock" in caught.value.hint
    assert (tmp_path / LOCK).exists()


def test_the_lock_of_a_process_that_was_killed_here_is_taken_at_once(tmp_path: Path) -> None:
    for changes in ({"pid": _ended()}, {"started": "1"}):  # gone, or its number given to another since
        _leave(tmp_path, machine=machine(), **changes)
        with locked(tmp_path, patience=0.0):
            owner = read_owner(tmp_path / LOCK)
            assert owner and owner.pid == os.getpid() and owner.token != "t" * 16
    assert not (tmp_path / LOCK).exists()


def test_work_that_must_not_be_lost_takes_an_abandoned_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locking, "ABANDONED_SECONDS", 0.05)
    for text in (None, "", "{}", "[" * 5000, '{"pid": "1"}'):
        if text is None:
            _leave(tmp_path)
        else:
            (tmp_path / LOCK).write_text(text)
        with locked(tmp_path, take_over=True):
            assert read_owner(tmp_path / LOCK)
        assert not (tmp_path / LOCK).exists()


def test_a_lock_is_removed_by_hand_unless_its_owner_is_at_work(tmp_path: Path) -> None:
    assert unlock(tmp_path) is None
    _leave(tmp_path)
    owner = unlock(tmp_path)
    assert owner and owner.host == "elsewhere" and not (tmp_path / LOCK).exists()
    with locked(tmp_path):
        with pytest.raises(StoreError, match="still running"):
            unlock(tmp_path)
        unlock(tmp_path, force=True)
        _leave(tmp_path)  # taken by another: not ours to release
    assert (tmp_path / LOCK).exists()


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot lock"), locked(tmp_path / "file"):
        pass
