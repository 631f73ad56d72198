"""Crashes, full disks and many writers: what is under a final name is whole, and what failed says so."""

from __future__ import annotations

import errno
import multiprocessing
import os
import resource
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from skillcli.errors import StoreError
from skillcli.store import Draft, Store, atomic, collect_garbage

pytestmark = pytest.mark.slow

Make = Callable[..., Draft]


def _leftovers(store: Store) -> list[Path]:
    return [path for path in store.root.rglob("*.h5") if path.is_file()]


@contextmanager
def _forked(work: Callable[[], None]) -> Iterator[multiprocessing.process.BaseProcess]:
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    yield process
    process.join()


def test_concurrent_writers_get_different_versions(store: Store, make: Make) -> None:
    parent = store.write(make("pretrain", name="other")).id

    def write_two(seed: int) -> None:
        for _ in range(2):
            store.write(make(seed=seed, parents=[parent]))

    with ExitStack() as stack:
        for seed in range(16):
            stack.enter_context(_forked(partial(write_two, seed)))
    ids = [one for one in store.ids() if one.name == "run"]
    assert [str(one) for one in ids] == [f"run/embed-means-v{n}" for n in range(1, 33)]
    assert sorted(store.read(one).seed for one in ids) == sorted([*range(16)] * 2)


def test_the_order_survives_a_power_cut(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is on the disk before its name is, and the name before success is told."""
    steps: list[str] = []
    fsync, replace, unlink = os.fsync, os.replace, Path.unlink

    def note_fsync(handle: int) -> None:
        path = Path(f"/proc/self/fd/{handle}").readlink()
        steps.append(f"sync {'temporary file' if path.name.startswith(atomic.TEMPORARY) else path.name}")
        fsync(handle)

    def note_replace(source: Path, target: Path) -> None:
        steps.append(f"name {target.name}")
        replace(source, target)

    def note_unlink(path: Path, missing_ok: bool = False) -> None:
        steps.append(f"remove {path.name}")
        unlink(path, missing_ok)

    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(os, "replace", note_replace)
    monkeypatch.setattr(Path, "unlink", note_unlink)
    one = store.write(make()).id
    assert steps[-5:] == ["sync .claims", "sync temporary file", "name embed-means-v1.h5", "remove .lock", "sync run"]
    steps.clear()
    store.remove(one)
    assert steps == ["remove embed-means-v1.h5", "sync run", "remove .lock"]
    steps.clear()
    two = store.write(make()).id
    (store.root / "run/.claims/embed-means-v2").unlink()
    steps.clear()
    store.remove(two)
    assert steps == ["sync .claims", "remove embed-means-v2.h5", "sync run", "remove .lock"]


def test_a_kill_leaves_no_damaged_artifact(store: Store, make: Make) -> None:
    reader, writer = os.pipe()

    def write_for_ever() -> None:
        while True:
            os.write(writer, f"{store.write(make()).id}\n".encode())

    for pause in range(0, 60, 4):
        with _forked(write_for_ever) as process:
            reported = os.read(reader, 1 << 16)  # waits until it is at work
            time.sleep(pause / 1000)
            process.kill()
        assert set(reported.decode().split()) <= {str(one) for one in store.ids()}
    os.close(writer)
    os.close(reader)
    assert [problem for one in store.ids() for problem in store.verify(one)] == []
    collect_garbage(store, keep=10**6)
    assert not list(store.root.rglob(".tmp*")) and not os.path.lexists(store.root / ".lock")


@pytest.fixture(params=["open", "write", "fsync", "replace"])
def broken(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The disk is full at one step of writing a file."""

    def fail(*_: Any, **__: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    real = Path.open

    def open_on_full_disk(path: Path, *arguments: Any, **more: Any) -> Any:
        if not path.name.startswith(atomic.TEMPORARY):
            return real(path, *arguments, **more)
        return fail() if request.param == "open" else real(Path("/dev/full"), "wb")

    if request.param in ("open", "write"):
        monkeypatch.setattr(Path, "open", open_on_full_disk)
    else:
        monkeypatch.setattr(os, request.param, fail)
    yield
    monkeypatch.undo()


def test_a_full_disk_is_reported_and_leaves_nothing(store: Store, make: Make, broken: None) -> None:
    with pytest.raises(StoreError, match="No space left") as caught:
        store.write(make())
    assert "the disk is full" in caught.value.hint
    assert "\n" not in caught.value.message
    assert _leftovers(store) == []


def test_a_file_that_may_not_grow_is_reported_and_leaves_nothing(store: Store, make: Make) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(StoreError, match="File too large"):
            store.write(make())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert _leftovers(store) == []


def test_the_next_write_after_a_failure_succeeds(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fail)
        with pytest.raises(StoreError, match="Input/output error"):
            store.write(make())
    assert store.write(make()).id.version == 2


def test_an_interrupt_cleans_up_and_goes_on(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", interrupt)
        with pytest.raises(KeyboardInterrupt):
            store.write(make())
    assert _leftovers(store) == []


def test_a_disk_that_alters_bytes_is_noticed(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.fsync

    def lose(handle: int) -> None:
        real(handle)
        if size := os.fstat(handle).st_size * stat.S_ISREG(os.fstat(handle).st_mode):
            os.pwrite(handle, b"\x55", size // 2)

    monkeypatch.setattr(os, "fsync", lose)
    with pytest.raises(StoreError, match="bytes have changed"):
        store.write(make("pretrain"))
    assert _leftovers(store) == []


def test_nothing_is_overwritten(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    one = store.write(make()).id
    before = store.path(one).read_bytes()
    monkeypatch.setattr(atomic, "claim_version", lambda *_: 1)
    with pytest.raises(StoreError, match="File exists"):
        store.write(make(seed=1))
    assert store.path(one).read_bytes() == before


def test_a_store_that_cannot_be_written_is_known_before_the_work(
    store: Store, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.check_writable("run")
    assert _leftovers(store) == [] and list((store.root / "run").iterdir()) == []

    def deny(*_: Any, **__: Any) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", deny)
        with pytest.raises(StoreError, match="Read-only file system"):
            store.check_writable("run")
    (store.root / "taken").write_text("a file")
    with pytest.raises(StoreError, match="cannot write in"):
        store.check_writable("taken")
    with pytest.raises(StoreError, match="cannot write in"):
        store.write(make(name="taken"))
