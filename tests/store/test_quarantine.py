"""Files from elsewhere meet libhdf5 in a process of their own, whose death is an answer."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from skillcli.errors import StoreError
from skillcli.store import Draft, Store, known, quarantine

Make = Callable[..., Draft]


@pytest.fixture
def elsewhere(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A store with run/embed-means-v1, which was not written here."""
    store.write(make())
    monkeypatch.setattr(known, "is_known", lambda _: False)
    return store


def test_what_comes_back_is_what_was_written(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    here = store.write(make())
    monkeypatch.setattr(known, "is_known", lambda _: False)
    there = store.read(here.id)
    assert there.content_sha256 == here.content_sha256
    for path, array in here.arrays.items():
        assert (there.arrays[path] == array).all() and there.arrays[path].dtype == array.dtype


def test_what_was_written_here_needs_no_other_process(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quarantine, "read_elsewhere", None)
    store.read(store.write(make()).id)


@pytest.mark.parametrize(
    ("death", "said"),
    [
        (signal.SIGSEGV, "ended in signal 11 of the process that did"),
        (signal.SIGXCPU, "took more than 3 s of CPU"),
        (signal.SIGALRM, "took more than 20 s"),
    ],
)
def test_the_death_of_the_reader_is_a_refusal(elsewhere: Store, monkeypatch: pytest.MonkeyPatch, death: int, said: str) -> None:
    [artifact] = elsewhere.ids()
    monkeypatch.setattr(quarantine._CHILD, "_channel", _stub(f"os.kill(os.getpid(), {int(death)})"))
    monkeypatch.setattr(quarantine._CHILD, "_owner", os.getpid())
    with pytest.raises(StoreError, match=f"cannot read .*: reading it {said}"):
        elsewhere.read(artifact)


def _stub(instead: str):  # type: ignore[no-untyped-def]
    """A child like the real one that does something else with every file."""
    import socket
    import subprocess
    import sys

    ours, theirs = socket.socketpair()
    program = (
        "import os, socket, sys\n"
        "from skillcli.store import quarantine_child as child\n"
        f"child._answer = lambda *_: {instead}\n"
        "child.serve(socket.socket(fileno=int(sys.argv[1])))\n"
    )
    with theirs:
        subprocess.Popen([sys.executable, "-c", program, str(theirs.fileno())], pass_fds=[theirs.fileno()])
    return ours


def test_a_child_that_was_killed_is_started_anew(elsewhere: Store) -> None:
    [artifact] = elsewhere.ids()
    elsewhere.read(artifact)
    assert quarantine._CHILD._channel is not None
    quarantine._CHILD._channel.close()
    elsewhere.read(artifact)


def test_where_no_child_can_start_it_is_said(elsewhere: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    quarantine._CHILD.close()
    monkeypatch.setattr(quarantine.sys, "executable", "/nowhere")
    [artifact] = elsewhere.ids()
    with pytest.raises(StoreError, match="cannot start the process that reads files from elsewhere"):
        elsewhere.read(artifact)


def test_too_much_data_from_elsewhere_is_refused(elsewhere: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quarantine, "MAX_DATA_BYTES", 1000)
    [artifact] = elsewhere.ids()
    with pytest.raises(StoreError, match="at most 1000 are read from elsewhere"):
        elsewhere.read(artifact)


def test_a_list_of_files_that_cannot_be_written_is_as_good_as_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    known._digests.cache_clear()
    try:
        assert not known.is_known("0" * 64)
        known.remember("0" * 64)
        assert known.is_known("0" * 64)
    finally:
        known._digests.cache_clear()
