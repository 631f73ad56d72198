from __future__ import annotations

import errno
import io
import os
import subprocess
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped,unused-ignore]
import numpy as np
import pytest
from command import CHAIN

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.store import ArtifactId, Draft, Store, block, codec, container
from skillcli.store.provenance import git_state
from tests.store.test_gc import with_parents

Make = Callable[..., Draft]


@pytest.mark.parametrize("kind", CHAIN)  # an execution: tests/stages/test_execution.py, a play: tests/stages/test_play.py
def test_what_is_written_is_read_back(store: Store, make: Make, kind: str) -> None:
    draft = make(kind, command="skill café \udcff")
    written = store.write(draft)
    read = store.read(written.id)
    assert str(read.id) == f"run/{kind}-v1"
    assert read == written
    assert read.arrays.keys() == draft.arrays.keys()
    for path, array in draft.arrays.items():
        np.testing.assert_array_equal(read.arrays[path], array)
        assert read.arrays[path].dtype == np.asarray(array).dtype
    assert read.command == draft.command
    assert read.recipe == draft.recipe and read.recipe_name == "smoke"
    assert (read.results["success_rate"], read.results["worst"]) == (0.5, None)  # NaN has no JSON form
    assert read.results.keys() == draft.results.keys() and read.measured == draft.measured
    assert "numpy" in read.packages
    assert read.bytes == store.path(read.id).stat().st_size
    assert store.verify(read.id) == []


def test_a_group_is_read_by_the_rest_of_its_paths(store: Store, make: Make) -> None:
    artifact = store.write(make("pretrain"))
    assert set(artifact.group("weights/policy")) == {"0.weight", "log_std"}
    assert "time" in artifact.group("trajectories/")


def test_other_hdf5_tools_find_names_units_and_provenance(store: Store, make: Make) -> None:
    artifact = store.write(make("pretrain"))
    with h5py.File(store.path(artifact.id)) as file:
        goal = file["skills/goal"]
        assert goal.attrs["dimensions"] == b"skill,xyz" and goal.attrs["unit"] == b"m"
        assert goal.fletcher32
        assert file["trajectories/time"].attrs["dimensions"] == b"step+1"
        assert file["weights/policy/0.weight"].attrs["dimensions"] == b"axis0,axis1"
        assert file.attrs["content_sha256"].decode() == artifact.content_sha256
        assert file.attrs["seed"] == 0


def test_big_endian_and_strided_arrays_hash_as_their_values_do(store: Store, make: Make) -> None:
    draft = make()
    given = {path: np.asarray(array) for path, array in draft.arrays.items()}
    turned = {path: array.astype(array.dtype.newbyteorder(">")) for path, array in given.items()}
    turned["embedding/mean"] = np.asfortranarray(turned["embedding/mean"])
    same = store.write(replace(draft, arrays=turned))
    assert same.content_sha256 == store.write(draft).content_sha256


def test_large_arrays_in_several_chunks_survive(store: Store, make: Make) -> None:
    weights = {"weights/a": np.random.default_rng(0).normal(size=(1001, 300)), "weights/b": np.zeros((3000, 500))}
    draft = make("pretrain")
    artifact = store.write(replace(draft, arrays={**draft.arrays, **weights}))
    np.testing.assert_array_equal(store.read(artifact.id).arrays["weights/a"], weights["weights/a"])
    assert artifact.bytes < 2.6e6  # the zeros are packed


@pytest.mark.slow
def test_large_arrays_of_zeros_are_no_bomb(store: Store, make: Make) -> None:
    draft = make("pretrain")
    artifact = store.write(replace(draft, arrays={**draft.arrays, "weights/a": np.zeros((70, 1 << 18), np.float32)}))
    assert artifact.bytes > 70 << 20
    assert store.verify(artifact.id) == []


def test_the_content_hash_ignores_names_times_and_speeds(store: Store, make: Make) -> None:
    first = store.write(make())
    again = make(name="other", command="skill again", measured={"wall_seconds": 9.0}, inputs_sha256="f" * 64)
    second = store.write(again)
    assert first.content_sha256 == second.content_sha256
    assert first.created_utc < second.created_utc


def test_the_content_hash_sees_every_change_of_meaning(store: Store, make: Make) -> None:
    base = make()
    nudged = {path: np.array(array) for path, array in base.arrays.items()}
    nudged["embedding/mean"][3, 1] = np.nextafter(nudged["embedding/mean"][3, 1], np.inf)
    parent = store.write(make("pretrain")).id
    changed: list[dict[str, Any]] = [
        {},
        {"arrays": nudged},
        {"arrays": {**base.arrays, "skills/goal": np.asarray(base.arrays["skills/goal"], np.float32)}},
        {"seed": 1},
        {"results": {**base.results, "success_rate": 0.6}},
        {"recipe": {"name": "smoke", "rate": 2e-3}},
        {"parents": [parent]},
        {"model_sha256": "n" * 64},
    ]
    hashes = {store.write(replace(base, **change)).content_sha256 for change in changed}
    assert len(hashes) == len(changed)


def test_versions_count_up_and_are_never_used_again(store: Store, make: Make) -> None:
    first, second = store.write(make()).id, store.write(make()).id
    assert (first.version, second.version) == (1, 2)
    store.remove(second)
    assert store.ids() == [first]
    assert store.write(make()).id.version == 3


def test_a_version_that_came_without_its_claim_is_not_used_again(store: Store, make: Make) -> None:
    one = store.write(make()).id
    (store.root / "run/.claims/embed-means-v1").unlink()
    store.remove(one)
    assert store.write(make()).id.version == 2


def test_removing_is_refused_while_something_depends_on_it(store: Store, make: Make) -> None:
    parent = store.write(make("pretrain")).id
    child = store.write(make("embed-means", parents=[parent])).id
    grandchild = store.write(make("compose", parents=[child, parent])).id
    assert store.dependents(parent) == [child, grandchild]
    assert store.lineage(grandchild) == [child, parent]
    with pytest.raises(StoreError, match="run/embed-means-v1, run/compose-v1 were made from it"):
        store.remove(parent)
    store.remove(grandchild)
    store.remove(child)
    store.remove(parent)
    assert store.ids() == []


def test_many_parents_outgrow_the_smallest_block(store: Store, make: Make) -> None:
    parents = [store.write(make(seed=seed)).id for seed in range(3)] * 20
    artifact = store.write(make("compose", parents=parents))
    assert [parent.id for parent in store.header(artifact.id).parents] == parents
    assert store.verify(artifact.id) == []


def test_a_missing_parent_is_refused_before_anything_is_written(store: Store, make: Make) -> None:
    with pytest.raises(UnknownArtifact, match="run/pretrain-v7"):
        store.write(make(parents=[ArtifactId("run", "pretrain", 7)]))
    assert not store.root.exists()


def test_verify_reports_parents_that_are_gone_or_changed(store: Store, make: Make) -> None:
    parent = store.write(make("pretrain")).id
    child = store.write(make(parents=[parent])).id
    other = store.write(make("pretrain", name="other", seed=1)).id
    path = store.path(parent)
    path.unlink()
    assert "no artifact 'run/pretrain-v1'" in store.verify(child)[0]
    path.write_bytes(store.path(other).read_bytes())
    assert "holds pretrain 'other/pretrain-v1'" in store.verify(child)[0]


def test_finished_work_is_found_by_its_inputs(store: Store, make: Make) -> None:
    first, second = store.write(make()).id, store.write(make(name="other")).id
    inputs = make().inputs_sha256
    assert store.find("embed-means", inputs) == [second, first]
    assert store.find("embed-means", inputs, name="run") == [first]
    assert store.find("compose", inputs) == [] == store.find("embed-means", "")


def test_without_an_id_the_newest_that_fits_is_meant(store: Store, make: Make) -> None:
    with pytest.raises(UnknownArtifact, match="no artifact of pretrain") as caught:
        store.resolve(None, ["pretrain"])
    assert "skill pretrain" in caught.value.hint
    store.write(make("pretrain", name="z"))
    newest = store.write(make("pretrain", name="a")).id
    last = store.write(make("compose", name="a")).id
    assert store.resolve(None, ["pretrain"]) == newest
    assert store.resolve("") == last
    assert store.resolve("z").name == "z"


def test_a_damaged_file_does_not_hide_the_others(store: Store, make: Make) -> None:
    good, bad, cut = (store.write(make()).id for _ in range(3))
    store.path(bad).write_bytes(b"not an artifact")
    store.path(cut).write_bytes(store.path(cut).read_bytes()[:-1])
    (store.root / "run/.tmp-compose-v1-1-ff.h5").write_bytes(b"half")
    (store.root / "notes.txt").write_text("mine")
    headers, unreadable = store.listing()
    assert [header.id for header in headers] == [good]
    assert [one.id for one in unreadable] == [bad, cut]
    store.remove(bad)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"embedding/mean": None}, "embedding/mean is missing"),
        ({"trajectories/position": None}, "one of trajectories/joint_position"),
        ({"surprise/x": np.zeros(3)}, "unknown array surprise/x"),
        ({"record/recipe": np.zeros(3)}, "cannot be stored under this path"),
        ({"embedding/../x": np.zeros(3)}, "cannot be stored under this path"),
        ({"embedding/std": np.zeros((4, 3))}, "skill = 4, expected 5 by embedding/goal_distance"),
        ({"skills/goal": np.zeros((5, 2))}, "xyz = 2, expected 3"),
        ({"trajectories/time": np.zeros(4)}, r"step\+1 = 4, expected 5"),
        ({"trajectories/latent": np.zeros((2, 4, 9))}, "latent = 9, expected 3"),
        ({"trajectories/length": np.zeros((2, 1))}, r"must be \(episode\), got shape \(2, 1\)"),
        ({"embedding/mean": np.array([[object()]])}, "has the type object"),
        ({"embedding/mean": np.zeros((5, 3), complex)}, "has the type complex128"),
    ],
)
def test_arrays_that_do_not_fit_the_kind_are_refused(store: Store, make: Make, changes: dict[str, Any], message: str) -> None:
    draft = make()
    arrays = {path: array for path, array in {**draft.arrays, **changes}.items() if array is not None}
    with pytest.raises(StoreError, match=message):
        store.write(replace(draft, arrays=arrays))
    assert not store.root.exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "other"}, "unknown kind, 'other'"),
        ({"name": "../up"}, "not an artifact id"),
        ({"seed": 2**63}, "is not between 0 and"),
        ({"seed": -1}, "seed -1 is not between 0 and"),
        ({"results": {"a": [1, {2, 3}]}}, r"results\.a\[1\] cannot be stored as JSON: set"),
        ({"recipe": {1: 2}}, "recipe cannot be stored"),
    ],
)
def test_drafts_that_cannot_be_kept_are_refused(store: Store, make: Make, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StoreError, match=message):
        store.write(replace(make(), **changes))
    assert not store.root.exists()


def test_curves_may_differ_in_length(store: Store, make: Make) -> None:
    draft = make("pretrain")
    store.write(replace(draft, arrays={**draft.arrays, "curves/evaluation": np.zeros(2)}))


def test_the_git_state_is_that_of_the_checkout(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
        subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)

    git("init")
    (tmp_path / "code.py").write_text("1")
    git("add", ".")
    git("commit", "-m", "first")
    commit, dirty = git_state(tmp_path)
    assert len(commit) == 40 and not dirty
    (tmp_path / "code.py").write_text("2")
    assert git_state(tmp_path) == (commit, True)
    assert git_state(Path("/")) == ("", False)


def test_within_a_series_the_number_decides_whatever_the_clock_said(
    store: Store, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Clock(datetime):
        year_now = 0

        @classmethod
        def now(cls, tz: Any = None) -> Clock:
            return cls(cls.year_now, 1, 1, tzinfo=tz)

    monkeypatch.setattr(codec, "datetime", Clock)

    def write(year: int, **changes: Any) -> ArtifactId:
        Clock.year_now = year
        return store.write(make(**changes)).id

    first, second, other = write(2026), write(2023), write(2024, name="other")
    assert [header.id for header in store.headers()] == [other, first, second]
    assert store.resolve(None) == store.resolve("run") == second
    assert store.find("embed-means", make().inputs_sha256)[0] == second
    assert write(2027, name="other") == store.resolve(None)


def test_what_is_no_artifact_is_named(store: Store, make: Make) -> None:
    one = store.write(make()).id
    store.pin(one)
    assert store.strangers() == []
    for name in ("notes.txt", "run/embed-means-v0.h5", "run/model.pt", "bad name"):
        (store.root / name).write_text("mine")
    (store.root / "run" / ".tmp-x").write_text("ours")
    (store.root / "run" / "plots").mkdir()
    found = [str(path.relative_to(store.root)) for path in store.strangers()]
    assert sorted(found) == ["bad name", "notes.txt", "run/embed-means-v0.h5", "run/model.pt", "run/plots"]


def test_a_name_without_room_is_said_before_the_work(store: Store, make: Make) -> None:
    store.write(make())
    (store.root / "run/.claims" / "embed-means-v9999999999").touch()  # not a version
    assert store.write(make()).id.version == 2
    (store.root / "run/.claims" / "embed-means-v999999999").touch()
    for attempt in (lambda: store.check_writable("run"), lambda: store.write(make())):
        with pytest.raises(StoreError, match="run/embed-means has had its last version, 999999999") as caught:
            attempt()
        assert "--name" in caught.value.hint


def test_removing_works_where_nothing_can_be_written(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk: not even an empty file can be made where the claim of a version is missing."""
    one = store.write(make()).id
    (store.root / "run/.claims/embed-means-v1").unlink()
    real = os.open

    def full(path: Any, flags: int, *more: Any, **others: Any) -> int:
        if flags & os.O_CREAT:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(path, flags, *more, **others)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", full)
        store.remove(one)
    assert store.ids() == [] and (store.root / "run/.claims/embed-means-v1").read_bytes() == b""
    assert store.write(make()).id.version == 2


def test_a_circle_can_be_removed(store: Store, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """No import lets one in; a store may hold one from before."""
    a, b, own, child = (store.write(make(name=name)).id for name in ("a", "b", "own", "child"))
    monkeypatch.setattr(Store, "_header", with_parents({a: [b], b: [a], own: [own], child: [a]}))
    monkeypatch.setattr(container, "may_mention", lambda *_: True)
    assert store.lineage(a) == [b, a] and store.lineage(own) == [own]
    with pytest.raises(StoreError, match="child/embed-means-v1 was made from it"):
        store.remove(a)
    for one in (child, a, b, own):
        store.remove(one)
    assert store.ids() == []


def test_dependents_are_found_in_any_spelling(store: Store, make: Make) -> None:
    parent = store.write(make("pretrain")).id
    plain, odd = (store.write(make("compose", parents=[parent])).id for _ in range(2))
    path = store.path(odd)
    data = path.read_bytes()
    path.write_bytes(data.replace(b'"run/pretrain-v1"', b'"run/pretra\\u0069n-v1"', 1).replace(b"\0" * 5, b"", 1))
    assert store.dependents(parent) == [plain, odd]


@pytest.mark.parametrize("length", [10, 5000])
def test_a_header_mentions_what_stands_anywhere_in_it(length: int) -> None:
    header = {"before": "x" * length, "id": "run/pretrain-v1"}
    block.seal(file := io.BytesIO(), header, block.block_size(header))
    assert block.may_mention(file, "run/pretrain-v1") and not block.may_mention(file, "run/pretrain-v11")
    assert not block.may_mention(io.BytesIO(b""), "run/pretrain-v1")


def test_nothing_is_removed_while_the_disk_hides_what_was_made_from_it(
    store: Store, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    parent = store.write(make("pretrain")).id
    child = store.write(make(parents=[parent])).id
    real = os.open

    def fail(path: Any, *more: Any, **others: Any) -> int:
        if str(path) == str(store.path(child)):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return real(path, *more, **others)

    monkeypatch.setattr(os, "open", fail)
    with pytest.raises(StoreError, match="Input/output error"):
        store.remove(parent)
    assert store.dependents(parent) == [] and parent in store.ids()
