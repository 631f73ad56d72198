"""Garbage: what is found is shown first, and never what something kept was made from."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from skillcli.errors import StoreError
from skillcli.store import (
    ArtifactId,
    Draft,
    Garbage,
    Header,
    Parent,
    Store,
    codec,
    collect_garbage,
    find_garbage,
    gc,
    listing,
    save_checkpoint,
    unlock,
)
from skillcli.store.atomic import LEFT_OVER_SECONDS, temporary_beside
from skillcli.store.gc import GRACE_SECONDS
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


def test_what_was_just_written_stays_with_what_it_was_made_from(store: Store, make: Make) -> None:
    """A chain whose training is no longer the newest of its name still finds it in its next stage."""
    first = store.write(make("pretrain")).id
    aged(store.path(first), GRACE_SECONDS + 60)
    child = store.write(make("embed-means", parents=[first])).id
    for _ in range(2):
        store.write(make("embed-means"))
        store.write(make("pretrain"))
    found = collect_garbage(store)
    assert names(found) == [] and [str(header.id) for header in found.young] == [
        "run/embed-means-v1",
        "run/embed-means-v2",
        "run/pretrain-v2",
    ]
    store.write(make("compose", parents=[child]))


def test_removing_lets_others_in_and_looks_again(lines: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    first = ArtifactId("run", "pretrain", 1)
    monkeypatch.setattr(gc, "HOLD_SECONDS", 0.0)

    def write_meanwhile() -> None:
        lines.write(make("compose", parents=[first]))

    monkeypatch.setattr(gc, "_let_others_in", write_meanwhile)
    assert names(collect_garbage(lines)) == ["run/embed-means-v1"]
    assert first in lines.ids()


def test_nothing_goes_once_the_lock_is_lost(lines: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk so slow that a writer thought the lock abandoned: its parent stays."""
    first, unlink = ArtifactId("run", "pretrain", 1), Store.unlink

    def slow(store: Store, one: ArtifactId) -> None:
        unlink(store, one)
        unlock(store.root, force=True)
        store.write(make("compose", parents=[first]))

    monkeypatch.setattr(Store, "unlink", slow)
    with pytest.raises(StoreError, match="taken over"):
        collect_garbage(lines)
    assert [problem for problems in lines.verify_all().values() for problem in problems] == []


def test_looking_skips_what_goes_meanwhile(lines: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    (lines.root / "run" / ".tmp-x").write_bytes(b"")
    look = listing.look

    def late(root: Path) -> listing.Names:
        found = look(root)
        lines.path(ArtifactId("run", "embed-means", 1)).unlink(missing_ok=True)
        (lines.root / "run" / ".tmp-x").unlink(missing_ok=True)
        return found

    monkeypatch.setattr(listing, "look", late)
    found = find_garbage(lines)
    assert names(found) == ["run/pretrain-v1"] and (found.unreadable, found.leftovers) == ([], [])
    shutil.rmtree(lines.root / "run")
    assert find_garbage(lines).artifacts == []


@pytest.mark.parametrize("closed", ["run", "run/.pins"])
def test_a_closed_folder_is_named_and_no_artifact_goes(lines: Store, make: Make, closed: str) -> None:
    other = lines.write(make(name="other")).id
    lines.pin(ArtifactId("run", "embed-means", 1))
    (lines.root / closed).chmod(0)

    def look() -> bool:
        found = lines.listing()
        assert other in [header.id for header in found.headers]
        assert [(one.id, one.problem.endswith(": Permission denied")) for one in found.unreadable] == [(f"{closed}/", True)]
        assert lines.verify_all()[f"{closed}/"] == [found.unreadable[0].problem] and lines.verify_all()[other] == []
        assert lines.resolve("other") == other
        return names(find_garbage(lines)) == []

    assert as_somebody_else(lines.root, look)


def test_a_file_that_may_not_be_read_is_named_and_no_artifact_goes(lines: Store) -> None:
    lines.path(ArtifactId("run", "embed-means", 2)).chmod(0)
    assert as_somebody_else(
        lines.root, lambda: [str(one.id) for one in find_garbage(lines).unreadable] == ["run/embed-means-v2"]
    )
    assert as_somebody_else(lines.root, lambda: names(find_garbage(lines)) == [])


def as_somebody_else(root: Path, look: Callable[[], bool]) -> bool:
    """Look as a user who may read only what others let them, which holds for root too when it has become somebody else."""
    for folder in (root, *root.parents):
        if folder.owner() == root.owner() and str(folder) != "/tmp":
            folder.chmod(folder.stat().st_mode | 0o055)

    def work() -> None:
        if os.getuid() == 0:
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
        assert look()

    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    process.join()
    return process.exitcode == 0


def test_figures_of_killed_processes_go(lines: Store) -> None:
    drawn, fresh, mine = (lines.root / "run" / name for name in (".compose-ab12_xyz.rrd", ".e-ab12_xy0.png", ".notes-mine.rrd"))
    for path in (drawn, fresh, mine):
        path.write_bytes(b"x")
    for path in (drawn, mine):
        aged(path, LEFT_OVER_SECONDS + 9)
    assert [one.path for one in collect_garbage(lines, keep=9).leftovers] == [drawn]


def test_a_circle_goes_too(lines: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """No import lets one in; a store may hold one from before."""
    a, b = ArtifactId("run", "embed-means", 1), ArtifactId("run", "pretrain", 1)
    monkeypatch.setattr(Store, "_header", with_parents({a: [b], b: [a]}))
    assert sorted(names(find_garbage(lines))) == ["run/embed-means-v1", "run/pretrain-v1"]
    assert names(collect_garbage(lines)) and a not in lines.ids() and b not in lines.ids()


def with_parents(parents: dict[ArtifactId, list[ArtifactId]]) -> Callable[[Store, ArtifactId], Header]:
    """Headers that say they were made from these."""
    header = Store._header

    def changed(store: Store, one: ArtifactId) -> Header:
        found = header(store, one)
        return replace(found, parents=tuple(Parent(parent, "0" * 64) for parent in parents.get(one, [])))

    return changed
