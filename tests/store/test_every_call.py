"""The disk fails, or the process is killed, at every single call that an operation makes to the system."""

from __future__ import annotations

import errno
import io
import itertools
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Draft, Store, block, codec, collect_garbage, export, find_garbage, import_file
from skillcli.store.gc import GRACE_SECONDS
from skillcli.store.lock import locked

pytestmark = pytest.mark.slow

Make = Callable[..., Draft]

CHANGING = ("write", "flush", "fsync", "replace", "rename", "unlink", "symlink", "mkdir", "truncate")
LOOKING = ("open", "read", "readlink", "scandir", "listdir", "lstat", "stat")


class _File:
    """An open file whose calls count too."""

    def __init__(self, file: Any, count: Callable[[str], None]) -> None:
        self._file, self._count = file, count

    def __getattr__(self, name: str) -> Any:
        if name in (*CHANGING, *LOOKING):
            self._count(name)
        return getattr(self._file, name)

    def __enter__(self) -> _File:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


@contextmanager
def counted(root: Path, names: tuple[str, ...], at: int, happen: Callable[[], None]) -> Iterator[list[str]]:
    """Count calls to the system about what is below a folder, and let something happen instead of the one with this number."""
    calls: list[str] = []
    below = f"{root}{os.sep}"

    def count(name: str) -> None:
        if name in names:
            calls.append(name)
            if len(calls) == at:
                happen()

    def counting(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **more: Any) -> Any:
            if any(isinstance(one, int) or str(one).startswith(below) for one in arguments[:2]):
                count(name)
            return real(*arguments, **more)

        return call

    real_open = io.open

    def opened(*arguments: Any, **more: Any) -> _File:
        if not str(arguments[0]).startswith(below):
            return real_open(*arguments, **more)
        count("open")
        return _File(real_open(*arguments, **more), count)

    patched = {name: counting(name, getattr(os, name)) for name in names if hasattr(os, name)}
    with mock.patch.multiple(os, **patched), mock.patch.object(io, "open", opened):
        yield calls


@pytest.fixture
def template(tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> Store:
    """Two old lines of descent, of which the older is garbage, and an export of another one."""
    monkeypatch.setattr(codec, "git_state", lambda: ("", False))
    monkeypatch.setattr(codec, "package_versions", dict)
    store, elsewhere = Store(tmp_path / "template"), Store(tmp_path / "elsewhere")
    for _ in range(2):
        parent = store.write(make("pretrain")).id
        child = store.write(make("embed-means", parents=[parent])).id
    for one in store.ids():
        os.utime(store.path(one), (time.time() - GRACE_SECONDS - 60,) * 2)
    (store.root / "run" / ".tmp-old").write_bytes(b"half")
    os.utime(store.root / "run" / ".tmp-old", (0, 0))
    parent = elsewhere.write(make("pretrain")).id
    child = elsewhere.write(make("embed-means", seed=3, parents=[parent])).id
    export(elsewhere, child, tmp_path / "in.tar")
    return store


Operation = Callable[[Store, Make], Callable[[], bool]]
"""Does something and returns a check of whether that is on the disk."""

FIRST, LAST = ArtifactId("run", "embed-means", 1), ArtifactId("run", "embed-means", 2)


def _write(store: Store, make: Make) -> Callable[[], bool]:
    one = store.write(make("compose", parents=[LAST])).id
    return lambda: store.verify(one) == []


def _import(store: Store, make: Make) -> Callable[[], bool]:
    found = import_file(store, store.root.parent / "in.tar")
    return lambda: not found[0].new and len(store.ids()) == 5 and not any(store.verify(one.id) for one in found)


def _collect(store: Store, make: Make) -> Callable[[], bool]:
    told = collect_garbage(store)
    return lambda: bool(told.unreadable) or (not find_garbage(store).artifacts and len(store.ids()) == 2)


def _remove(store: Store, make: Make) -> Callable[[], bool]:
    store.remove(LAST)
    return lambda: LAST not in store.ids() and (store.root / "run/.claims/embed-means-v2").exists()


def _pin(store: Store, make: Make) -> Callable[[], bool]:
    store.pin(FIRST)
    return lambda: FIRST in store.pinned()


def _export(store: Store, make: Make) -> Callable[[], bool]:
    export(store, LAST, store.root.parent / "out.tar")
    return lambda: [one.new for one in import_file(store, store.root.parent / "out.tar")] == [False, False]


OPERATIONS: list[Operation] = [_write, _import, _collect, _remove, _pin, _export]


def _copy(template: Store) -> Store:
    root = template.root.parent / "store"
    shutil.rmtree(root, ignore_errors=True)
    (root.parent / "out.tar").unlink(missing_ok=True)
    return Store(Path(shutil.copytree(template.root, root)))


def _assert_sound(store: Store) -> None:
    """Nothing damaged, no parent lost, and nothing that others wait for."""
    headers, unreadable = store.listing()
    assert unreadable == []
    for header in headers:
        with store.path(header.id).open("rb") as file:
            block.check_digest(file)
        assert [store.parent_problem(parent) for parent in header.parents if store.parent_problem(parent)] == []
    with locked(store.root, patience=0.0):
        pass


@pytest.mark.parametrize(("code", "names"), [(errno.EIO, (*CHANGING, *LOOKING)), (errno.ENOSPC, CHANGING)])
@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_error_at_any_call_is_one_line_and_leaves_the_store_sound(
    template: Store, make: Make, operation: Operation, code: int, names: tuple[str, ...]
) -> None:
    def fail() -> None:
        raise OSError(code, os.strerror(code))

    told = 0
    for at in itertools.count(1):
        store = _copy(template)
        try:
            with counted(template.root.parent, names, at, fail) as calls:
                check = operation(store, make)
        except StoreError as error:
            told += 1
            assert "\n" not in error.message, error.message
        else:
            assert check(), f"told as done after {calls}"
        _assert_sound(store)
        if len(calls) < at:
            break
    assert told and at >= 5


@pytest.mark.parametrize("operation", OPERATIONS)
def test_a_kill_at_any_change_leaves_the_store_sound(template: Store, make: Make, operation: Operation) -> None:
    for at in itertools.count(1):
        store = _copy(template)

        def work(at: int = at, store: Store = store) -> None:
            with counted(template.root.parent, CHANGING, at, lambda: os._exit(9)):
                operation(store, make)

        process = multiprocessing.get_context("fork").Process(target=work)
        process.start()
        process.join()
        if process.exitcode == 0:
            break
        assert process.exitcode == 9
        _assert_sound(store)
        gone = operation is _remove and LAST not in store.ids()
        (store.root.parent / "out.tar").unlink(missing_ok=True)
        assert gone or operation(store, make)(), f"not done again after a kill at change {at}"
        collect_garbage(store)
        assert list(store.root.rglob(".tmp*")) == list(store.root.parent.glob(".tmp*")) == []
    assert at >= 5
