"""Garbage: what is found is shown first, and never what something kept was made from."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Draft, Garbage, Store, codec, collect_garbage, find_garbage, save_checkpoint
from skillcli.store.atomic import LEFT_OVER_SECONDS, temporary_beside
from skillcli.store.collect import GRACE_SECONDS
from skillcli.store.process import machine_tag

Make = Callable[..., Draft]


def names(garbage: Garbage) -> list[str]:
    return [str(header.id) for header in garbage.artifacts]


def aged(path: Path, seconds: float) -> Path:
    os.utime(path, (time.time() - seconds,) * 2)
    return path


def old(store: Store) -> Store:
    """The same store, in which nothing was written lately."""
    for one in store.ids():
        aged(store.path(one), GRACE_SECONDS + 60)
    return store


@pytest.fixture
def lines(store: Store, make: Make) -> Store:
    """Two lines of descent from two trainings of one name: pretrain-v1 → embed-means-v1, pretrain-v2 → embed-means-v2."""
    for _ in range(2):
        parent = store.write(make("pretrain")).id
        store.write(make("embed-means", parents=[parent]))
    return old(store)


def test_the_newest_and_what_they_were_made_from_stay(lines: Store, make: Make) -> None:
    assert names(find_garbage(lines)) == ["run/embed-means-v1", "run/pretrain-v1"]  # a child goes before its parent
    first = ArtifactId("run", "embed-means", 1)
    lines.write(make("compose", parents=[first]))
    assert names(find_garbage(lines)) == []
    assert names(find_garbage(lines, keep=2)) == []


def test_a_pin_keeps_a_whole_line(lines: Store) -> None:
    first = ArtifactId("run", "embed-means", 1)
    lines.pin(first)
    assert lines.pinned() == {first}
    assert names(find_garbage(lines)) == []
    with pytest.raises(StoreError, match="it is pinned") as caught:
        lines.remove(first)
    assert "skill unpin" in caught.value.hint
    lines.pin(first, False)
    lines.pin(first, False)
    assert len(names(find_garbage(lines))) == 2


def test_collecting_removes_what_was_shown_and_numbers_stay_taken(lines: Store, make: Make) -> None:
    shown = find_garbage(lines)
    assert shown.bytes == sum(header.bytes for header in shown.artifacts) > 0
    assert names(collect_garbage(lines)) == names(shown)
    assert [str(one) for one in lines.ids()] == ["run/embed-means-v2", "run/pretrain-v2"]
    assert lines.write(make("pretrain")).id.version == 3
    assert [problem for one in lines.ids() for problem in lines.verify(one)] == []


def test_no_artifact_goes_while_one_cannot_be_read(lines: Store) -> None:
    lines.path(ArtifactId("run", "embed-means", 2)).write_bytes(b"half")
    found = collect_garbage(lines)
    assert names(found) == [] and [str(one.id) for one in found.unreadable] == ["run/embed-means-v2"]


def test_files_of_killed_processes_go_and_those_of_others_stay(lines: Store) -> None:
    folder = lines.root / "run"
    killed = folder / f".tmp-compose-v1-{machine_tag()}-{2**22 + 1}-ff.h5"
    elsewhere = folder / ".tmp-compose-v2-00000000-1-ff.h5"
    ancient, mine, notes = folder / ".tmp-odd", temporary_beside(folder / "compose-v4.h5"), folder / ".notes"
    for path in (killed, elsewhere, ancient, mine, notes):
        path.write_bytes(b"12345")
    aged(ancient, LEFT_OVER_SECONDS + 9)
    found = collect_garbage(lines, keep=9)
    assert {one.path for one in found.leftovers} == {killed, ancient} and found.bytes == 10
    assert {path.name for path in folder.glob(".*") if path.is_file()} == {elsewhere.name, mine.name, notes.name}


def test_a_checkpoint_goes_only_when_its_training_is_finished(lines: Store, make: Make) -> None:
    finished = lines.checkpoint_path("run", "pretrain", make().inputs_sha256)
    open_ = lines.checkpoint_path("run", "pretrain", "a" * 64)
    for path in (finished, open_):
        save_checkpoint(path, {}, {})
        aged(path, GRACE_SECONDS - 60)
    assert find_garbage(lines).leftovers == []  # it may be written by a repetition at this moment
    for path in (finished, open_):
        aged(path, GRACE_SECONDS + 60)
    found = find_garbage(lines)
    assert [one.path for one in found.leftovers] == [finished] and found.unfinished == [open_]


def test_an_empty_store_has_no_garbage(store: Store) -> None:
    assert find_garbage(store) == Garbage([], [], [], [], [])
    assert not store.root.exists()


def test_a_parent_that_goes_in_the_middle_of_the_work_is_said(
    lines: Store, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:

    encode, first = codec.encode, ArtifactId("run", "embed-means", 1)

    def slow(*words: object) -> object:
        monkeypatch.undo()
        lines.remove(first)
        return encode(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(codec, "encode", slow)
    with pytest.raises(StoreError, match="no artifact 'run/embed-means-v1'"):
        lines.write(make("compose", parents=[first]))
    assert not list(lines.root.rglob("compose*.h5")) and not list(lines.root.rglob(".tmp*"))
