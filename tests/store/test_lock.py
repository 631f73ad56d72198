"""The store's lock: exclusive, explained, and never in the way after a crash."""

from __future__ import annotations

import errno
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from skillcli.errors import StoreError
from skillcli.store import Draft, Store, collect_garbage, unlock
from skillcli.store import lock as locking
from skillcli.store.lock import LOCK, Owner, locked
from skillcli.store.process import boot_tag, machine_tag, started


def _leave(root: Path, age: float = 0.0, **changes: str) -> None:
    """A lock as a process leaves it."""
    pid = os.getpid()
    fields = {"token": "abcdef", "host": "012345", "boot": "0123", "machine": "01234567", "pid": f"{pid:x}"}
    named = {**fields, "started": f"{int(started(pid)):x}", "name": "elsewhere", **changes}
    root.mkdir(exist_ok=True)
    (root / LOCK).unlink(missing_ok=True)
    (root / LOCK).symlink_to(":".join(["skill", *named.values()]))
    os.utime(root / LOCK, (time.time() - age,) * 2, follow_symlinks=False)


def _owner(root: Path) -> Owner | None:
    """Whose lock there is; None where there is none, or nothing legible in it."""
    seen = locking._look(root / LOCK)
    return seen.owner if seen else None


def _free(root: Path) -> bool:
    return not os.path.lexists(root / LOCK)


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
    assert count == 120 and _free(tmp_path)


def test_the_owner_and_its_age_are_told(tmp_path: Path) -> None:
    _leave(tmp_path, age=40)
    said = rf"locked by process {os.getpid()} on elsewhere since 4\d s"
    with pytest.raises(StoreError, match=said) as caught, locked(tmp_path, patience=0.05):
        pass
    assert "skill unlock" in caught.value.hint
    assert not _free(tmp_path)


def test_the_lock_of_a_process_that_was_killed_here_is_taken_at_once(tmp_path: Path) -> None:
    for changes in ({"pid": f"{_ended():x}"}, {"started": "1"}):  # gone, or its number given to another since
        _leave(tmp_path, machine=machine_tag(), **changes)
        with locked(tmp_path, patience=0.0):
            owner = _owner(tmp_path)
            assert owner and owner.here and owner.pid == os.getpid() and owner.name != "elsewhere"
    assert _free(tmp_path)


def test_the_lock_from_before_a_start_of_this_machine_is_taken_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locking, "host_tag", lambda: "abc123")
    monkeypatch.setattr(locking, "booted", lambda: time.time() - 60)
    _leave(tmp_path, age=90, host="abc123")
    with locked(tmp_path, patience=0.0):
        pass
    for age, changes in (
        (90.0, {"host": "abc124"}),  # of another machine
        (90.0, {"host": ""}),  # of one that nothing is known of
        (90.0, {"host": "abc123", "boot": boot_tag()}),  # of another container
        (30.0, {"host": "abc123"}),  # of a machine that only looks the same: this one had started by then
    ):
        _leave(tmp_path, age, **changes)
        with pytest.raises(StoreError, match="is locked by process"), locked(tmp_path, patience=0.0):
            pass


@pytest.mark.slow
def test_a_lock_is_never_without_an_owner(tmp_path: Path) -> None:
    """Killed at any moment, a process leaves no lock that others wait for."""

    def lock_for_ever() -> None:
        while True:
            with locked(tmp_path):
                pass

    for pause in range(10):
        process = multiprocessing.get_context("fork").Process(target=lock_for_ever)
        process.start()
        time.sleep(0.01 + pause / 1000)
        process.kill()
        process.join()
        with locked(tmp_path, patience=0.0):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_lock_takes_no_block_of_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.uname()
    monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(nodename=f"{real.nodename} \n:{'long' * 30}"))
    with locked(tmp_path):
        text = str((tmp_path / LOCK).readlink())
        assert len(text) == 59  # as much as ext4 keeps in the inode
        owner = _owner(tmp_path)
        assert owner and owner.pid == os.getpid()


@pytest.mark.parametrize("code", [errno.EPERM, errno.EOPNOTSUPP])
def test_where_links_cannot_be_made_a_file_is_the_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    def refuse(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "symlink", refuse)
    with locked(tmp_path):
        owner = _owner(tmp_path)
        assert owner and owner.here and not owner.gone
        with pytest.raises(StoreError, match=f"locked by process {os.getpid()}"), locked(tmp_path, patience=0.01):
            pass
    assert _free(tmp_path)
    monkeypatch.setattr(os, "write", refuse)
    with pytest.raises(StoreError, match=f"cannot lock {tmp_path}"), locked(tmp_path):
        pass
    assert _free(tmp_path)


def _fifo(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("put", "found"),
    [
        (_fifo, "a pipe"),
        (Path.mkdir, "a folder"),
        (lambda path: path.symlink_to("nowhere"), "a link to 'nowhere'"),
        (lambda path: path.symlink_to(path.parent / "precious"), "a link to '/"),
    ],
)
def test_what_is_no_lock_is_refused_and_left_alone(
    store: Store, make: Callable[..., Draft], put: Callable[[Path], None], found: str
) -> None:
    one = store.write(make()).id
    (store.root / "precious").write_text("mine")
    put(store.root / LOCK)
    for attempt in (
        lambda: store.write(make()),
        lambda: store.remove(one),
        lambda: store.pin(one),
        lambda: collect_garbage(store),
        lambda: unlock(store.root, force=True),
    ):
        with pytest.raises(StoreError, match=f"expected a lock of skill .*, found {found}") as caught:
            attempt()
        assert "\n" not in caught.value.message
    assert os.path.lexists(store.root / LOCK) and (store.root / "precious").read_text() == "mine"
    assert store.ids() == [one]


def test_whoever_lost_the_lock_is_told(tmp_path: Path) -> None:
    with locked(tmp_path) as still_held:
        still_held()
        _leave(tmp_path)
        with pytest.raises(StoreError, match="taken over"):
            still_held()
        unlock(tmp_path)
        with pytest.raises(StoreError, match="taken over"):
            still_held()


def test_work_that_must_not_be_lost_takes_an_abandoned_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locking, "ABANDONED_SECONDS", 0.05)
    for text in (None, "", "{}", "[" * 5000, '{"pid": "1"}'):
        if text is None:
            _leave(tmp_path)
        else:
            (tmp_path / LOCK).write_text(text)
        with locked(tmp_path, take_over=True):
            assert _owner(tmp_path)
        assert _free(tmp_path)


def test_a_lock_is_removed_by_hand_unless_its_owner_is_at_work(tmp_path: Path) -> None:
    assert unlock(tmp_path) is None
    _leave(tmp_path)
    owner = unlock(tmp_path)
    assert owner and owner.name == "elsewhere" and _free(tmp_path)
    with locked(tmp_path):
        with pytest.raises(StoreError, match="still running"):
            unlock(tmp_path)
        unlock(tmp_path, force=True)
        _leave(tmp_path)  # taken by another: not ours to release
    assert not _free(tmp_path)


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot lock"), locked(tmp_path / "file"):
        pass
