"""Exports: one file with all ancestors; imports: nothing believed, nothing half done."""

from __future__ import annotations

import errno
import gzip
import hashlib
import io
import json
import os
import shutil
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Draft, Parent, Store, archive, atomic, codec, collect_garbage, export, import_file
from skillcli.store.process import machine_tag
from tests.store.test_gc import with_parents

pytestmark = pytest.mark.slow

Make = Callable[..., Draft]


@pytest.fixture
def line(store: Store, make: Make) -> list[ArtifactId]:
    """A chain of three and a stranger; ancestors first."""
    store.write(make("pretrain", name="stranger", seed=9))
    first = store.write(make("pretrain")).id
    second = store.write(make("embed-means", parents=[first])).id
    return [first, second, store.write(make("compose", name="plan", parents=[second, first])).id]


@pytest.fixture
def exported(store: Store, line: list[ArtifactId], tmp_path: Path) -> Path:
    path = tmp_path / "plan.tar"
    assert export(store, line[-1], path) == line
    return path


@pytest.fixture
def other(tmp_path: Path) -> Store:
    return Store(tmp_path / "other")


def rewrite(path: Path, change: Callable[[str, bytes], list[tuple[str, bytes]]]) -> None:
    """Change the members of a tar one by one."""
    with tarfile.open(path) as tar:
        members = [(one.name, tar.extractfile(one).read()) for one in tar]  # type: ignore[union-attr]
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for name, data in (changed for member in members for changed in change(*member)):
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))


def edit(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the manifest of an export."""

    def changed(name: str, data: bytes) -> list[tuple[str, bytes]]:
        if name != "manifest.json":
            return [(name, data)]
        manifest = json.loads(data)
        change(manifest)
        return [(name, json.dumps(manifest).encode())]

    rewrite(path, changed)


def refused(other: Store, path: Path) -> str:
    with pytest.raises(StoreError) as caught:
        import_file(other, path)
    assert other.ids() == [] and not list(other.root.glob(".tmp*"))
    assert "\n" not in caught.value.message
    return caught.value.message


def test_an_export_comes_back_whole_with_its_ancestors(
    store: Store, other: Store, line: list[ArtifactId], exported: Path
) -> None:
    imported = import_file(other, exported)
    assert [one.id for one in imported] == line and all(one.new for one in imported)
    assert other.ids() == sorted(line)
    assert [problem for one in line for problem in other.verify(one)] == []
    assert all(other.path(one).read_bytes() == store.path(one).read_bytes() for one in line)
    assert not any(one.new for one in import_file(other, exported))
    assert other.ids() == sorted(line)


def test_the_same_export_twice_is_the_same_file_and_any_tar_can_open_it(
    store: Store, line: list[ArtifactId], exported: Path, tmp_path: Path
) -> None:
    export(store, line[-1], tmp_path / "again.tar")
    assert (tmp_path / "again.tar").read_bytes() == exported.read_bytes()
    with tarfile.open(exported) as tar:
        assert tar.getnames() == ["manifest.json", *(f"{one}.h5" for one in line)]
    with pytest.raises(StoreError, match="File exists"):
        export(store, line[-1], exported)


def test_ids_that_are_taken_by_other_content_get_the_next_version(other: Store, make: Make, exported: Path) -> None:
    mine = other.write(make("pretrain", seed=5)).id
    imported = import_file(other, exported)
    assert [str(one.id) for one in imported] == ["run/pretrain-v2", "run/embed-means-v1", "plan/compose-v1"]
    assert str(imported[0].exported) == str(mine) == "run/pretrain-v1"
    assert [str(parent.id) for parent in other.header(imported[2].id).parents] == ["run/embed-means-v1", "run/pretrain-v2"]
    assert [problem for one in other.ids() for problem in other.verify(one)] == []
    assert other.write(make("pretrain")).id.version == 3


def test_a_single_file_can_be_imported_too(store: Store, other: Store, line: list[ArtifactId], tmp_path: Path) -> None:
    path = shutil.copy(store.path(line[0]), tmp_path / "some.h5")
    assert [one.id for one in import_file(other, path)] == [line[0]]
    assert other.verify(line[0]) == []


def test_an_artifact_with_a_damaged_ancestor_is_not_exported(store: Store, line: list[ArtifactId], tmp_path: Path) -> None:
    data = bytearray(store.path(line[0]).read_bytes())
    data[-1] ^= 1
    store.path(line[0]).write_bytes(data)
    with pytest.raises(StoreError, match="bytes have changed"):
        export(store, line[-1], tmp_path / "x.tar")
    assert not (tmp_path / "x.tar").exists()


def test_a_change_of_any_byte_is_refused(other: Store, exported: Path) -> None:
    good = exported.read_bytes()
    size = len(good.rstrip(b"\0"))
    for place in [*range(0, size, size // 40), 3, 150, 156, 600]:
        bad = bytearray(good)
        bad[place] ^= 0x41
        exported.write_bytes(bad)
        try:
            import_file(other, exported)
        except StoreError:
            assert other.ids() == []
        else:  # padding between members, which means nothing
            assert good[place] == 0
            shutil.rmtree(other.root)
    for length in (0, 100, 512, 2000, size - 1):
        exported.write_bytes(good[:length])
        refused(other, exported)


def test_paths_that_leave_the_store_are_refused(other: Store, exported: Path) -> None:
    good = exported.read_bytes()
    for name in ("../../away", "/etc/passwd", "run/../../pretrain-v1", "run\\pretrain-v1", "run/pretrain-v1\n", "a" * 90):
        exported.write_bytes(good)
        rewrite(exported, lambda old, data, name=name: [(f"{name}.h5" if "pretrain" in old else old, data)])  # type: ignore[misc]
        assert "not where its manifest says" in refused(other, exported)
        exported.write_bytes(good)
        edit(exported, lambda manifest, name=name: manifest["artifacts"][0].update(id=name))  # type: ignore[misc]
        assert "not an artifact id" in refused(other, exported)


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE, tarfile.XHDTYPE,
                                  tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_SPARSE, tarfile.CHRTYPE])  # fmt: skip
def test_only_plain_files_are_known(other: Store, exported: Path, kind: bytes) -> None:
    good = exported.read_bytes()
    info = tarfile.TarInfo("run/pretrain-v1.h5")
    info.type, info.linkname = kind, "/etc/passwd"
    for place in (0, -(-(512 + int(good[124:135], 8)) // 512) * 512):  # instead of the manifest, and behind it
        exported.write_bytes(good[:place] + info.tobuf(tarfile.USTAR_FORMAT) + good[place:])
        assert "regular file" in refused(other, exported)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.update(version=2), "format 2"),
        (lambda m: m.update(version=1.0), "format 1.0"),
        (lambda m: m.update(version=True), "format True"),
        (lambda m: m.update(more=1), "not in the form"),
        (lambda m: m.pop("artifacts"), "not in the form"),
        (lambda m: m.update(format="zip"), "not an export"),
        (lambda m: m.update(artifacts=[]), "no artifacts"),
        (lambda m: m.update(artifacts=m["artifacts"] * 400), "more than 6"),
        (lambda m: m["artifacts"].append(3), "not in the form"),
        (lambda m: m["artifacts"][0].update(bytes=-1), "not where"),
        (lambda m: m["artifacts"][0].update(bytes=1 << 60), "not where"),
        (lambda m: m["artifacts"][0].update(bytes=True), "not in the form"),
        (lambda m: m["artifacts"][1].update(content_sha256="0" * 64), "not what its manifest says"),
        (lambda m: m["artifacts"].pop(), "more than its manifest"),
        (lambda m: m["artifacts"].append(m["artifacts"][0]), "not where"),
    ],
)
def test_a_manifest_that_does_not_fit_is_refused(
    other: Store, exported: Path, change: Callable[[dict[str, Any]], Any], message: str
) -> None:
    edit(exported, change)
    assert message in refused(other, exported)


def test_a_child_without_its_parent_is_refused(other: Store, exported: Path) -> None:
    edit(exported, lambda manifest: manifest["artifacts"].pop(0))
    rewrite(exported, lambda name, data: [] if name == "run/pretrain-v1.h5" else [(name, data)])
    assert "before what it was made from" in refused(other, exported)


def test_what_the_last_artifact_was_not_made_from_is_refused(other: Store, store: Store, exported: Path) -> None:
    stranger = ArtifactId("stranger", "pretrain", 1)
    data = store.path(stranger).read_bytes()
    told = {"id": str(stranger), "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    told["content_sha256"] = store.header(stranger).content_sha256
    edit(exported, lambda manifest: manifest["artifacts"].insert(0, told))
    added = [(f"{stranger}.h5", data)]
    rewrite(exported, lambda name, held: [(name, held), *added] if name == "manifest.json" else [(name, held)])
    assert "stranger/pretrain-v1 is in it, and plan/compose-v1 was not made from it" in refused(other, exported)


def test_what_is_no_export_is_refused(other: Store, tmp_path: Path) -> None:
    path = tmp_path / "x"
    with pytest.raises(StoreError, match="No such file"):
        import_file(other, path)
    for data in (b"", b"PK\x03\x04" * 400, b"skill-store 1 block=0004096", os.urandom(5000)):
        path.write_bytes(data)
        refused(other, path)
    path.unlink()
    os.mkfifo(path)
    assert "not a file" in refused(other, path)


def test_a_single_file_needs_what_it_was_made_from(
    store: Store, other: Store, line: list[ArtifactId], exported: Path, tmp_path: Path
) -> None:
    child = Path(shutil.copy(store.path(line[1]), tmp_path / "child.h5"))
    with pytest.raises(StoreError, match=r"run/embed-means-v1 was made from run/pretrain-v1, which is neither") as caught:
        import_file(other, child)
    assert other.ids() == [] and "skill export" in caught.value.hint
    import_file(other, store.path(line[0]))
    assert [one.id for one in import_file(other, child)] == [line[1]]
    assert other.verify(line[1]) == []


def test_a_single_file_finds_its_parent_under_another_number(
    store: Store, other: Store, make: Make, line: list[ArtifactId]
) -> None:
    other.write(make("pretrain", seed=5))
    import_file(other, store.path(line[0]))
    import_file(other, store.path(line[1]))
    assert [str(parent.id) for parent in other.header(line[1]).parents] == ["run/pretrain-v2"]


def test_parents_of_what_is_being_imported_are_needed(
    other: Store, make: Make, exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither collected in between, though not the newest of their series, nor removed unnoticed."""
    import_file(other, exported)
    for one in reversed(other.ids()):
        if one.stage != "pretrain":
            other.path(one).unlink()
    other.write(make("pretrain", seed=7))
    encode = codec.encode

    def meanwhile(then: Callable[[], object]) -> Callable[..., object]:
        def encoding(artifact: Any) -> object:
            if artifact.kind != "pretrain":
                then()
            return encode(artifact)

        return encoding

    monkeypatch.setattr(codec, "encode", meanwhile(lambda: collect_garbage(other)))
    assert [problem for one in import_file(other, exported) for problem in other.verify(one.id)] == []
    for one in other.ids():
        if one.stage != "pretrain":
            other.path(one).unlink()
    monkeypatch.setattr(codec, "encode", meanwhile(lambda: other.path(ArtifactId("run", "pretrain", 1)).unlink()))
    with pytest.raises(StoreError, match="no artifact 'run/pretrain-v1'"):
        import_file(other, exported)


def test_two_imports_at_once_keep_one_copy(other: Store, exported: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    encode = codec.encode

    def twice(artifact: Any) -> object:
        monkeypatch.setattr(codec, "encode", encode)
        import_file(other, exported)
        return encode(artifact)

    monkeypatch.setattr(codec, "encode", twice)
    assert not any(one.new for one in import_file(other, exported))
    assert len(other.ids()) == 3


@pytest.mark.parametrize("place", [200, -1])  # in the header; behind it
def test_a_damaged_copy_is_said_and_replaced_on_request(
    other: Store, line: list[ArtifactId], exported: Path, place: int
) -> None:
    import_file(other, exported)
    path = other.path(line[1])
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)
    with pytest.raises(StoreError, match="run/embed-means-v1 is here, but damaged") as caught:
        import_file(other, exported)
    assert "skill import --replace" in caught.value.hint and path.read_bytes() == data
    found = import_file(other, exported, replace_damaged=True)
    assert [(one.id, one.new, one.replaced) for one in found] == [
        (line[0], False, False), (line[1], False, True), (line[2], False, False),
    ]  # fmt: skip
    assert not any(one.replaced for one in import_file(other, exported, replace_damaged=True))
    assert [problem for one in other.ids() for problem in other.verify(one)] == []


def test_a_copy_that_the_disk_cannot_read_is_not_called_damaged(
    other: Store, line: list[ArtifactId], exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import_file(other, exported)
    real = os.open

    def fail(path: Any, *more: Any, **others: Any) -> int:
        if str(path) == str(other.path(line[0])):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return real(path, *more, **others)

    monkeypatch.setattr(os, "open", fail)
    with pytest.raises(StoreError, match="Input/output error"):
        import_file(other, exported, replace_damaged=True)
    assert len(other.ids()) == 3


def test_numbers_beyond_reach_are_not_taken_over(
    store: Store, other: Store, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.write(make("pretrain", seed=1))
    monkeypatch.setattr(atomic, "claim_version", lambda *_: 999_999_999)
    last = store.write(make("pretrain")).id
    monkeypatch.undo()
    export(store, store.write(make(parents=[last])).id, tmp_path / "x.tar")
    assert [str(one.id) for one in import_file(other, tmp_path / "x.tar")] == ["run/pretrain-v1", "run/embed-means-v1"]
    assert other.verify(ArtifactId("run", "embed-means", 1)) == []
    assert other.write(make("pretrain")).id.version == 2


def test_what_was_made_from_itself_is_not_exported(
    store: Store, line: list[ArtifactId], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Store, "_header", with_parents({line[0]: [line[1]], line[1]: [line[0]]}))
    with pytest.raises(StoreError, match="was made from itself"):
        export(store, line[1], tmp_path / "x.tar")
    chain = [ArtifactId("run", "pretrain", number) for number in range(1, 3000)]
    monkeypatch.setattr(Store, "header", lambda _, one: SimpleNamespace(parents=tuple(Parent(p, "") for p in after(one))))

    def after(one: ArtifactId) -> list[ArtifactId]:
        return [replace(one, version=one.version + 1)] if one.version < len(chain) else []

    assert archive.ancestors_first(store, chain[0]) == chain[::-1]


def test_exporting_removes_what_a_killed_export_left(store: Store, line: list[ArtifactId], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    killed = folder / f".tmp-e-{machine_tag()}-{2**22 + 1}-01234567.tar"
    others = [folder / f".tmp-e-00000000-{2**22 + 1}-01234567.tar", folder / ".tmp-mine.tar", folder / "e.tar"]
    for path in (killed, *others):
        path.write_bytes(b"half")
    export(store, line[0], folder / "new.tar")
    assert sorted(folder.iterdir()) == sorted([*others, folder / "new.tar"])


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (gzip.compress(b"anything", mtime=0), "packed with gzip"),
        (b"\x89HDF\r\n\x1a\n" + bytes(600), "another HDF5 file"),
        (b"PK\3\4" + bytes(600), "a zip file"),
        (b"hello", "neither an export of skill nor an artifact's file"),
        (b"", "it is empty"),
    ],
)
def test_what_was_never_ours_is_called_what_it_is(store: Store, tmp_path: Path, data: bytes, what: str) -> None:
    path = tmp_path / "given"
    path.write_bytes(data)
    with pytest.raises(StoreError) as caught:
        import_file(store, path)
    assert what in caught.value.message
    assert "remove" not in caught.value.hint


def test_a_plain_tar_is_called_one(store: Store, tmp_path: Path) -> None:
    path = tmp_path / "plain.tar"
    with tarfile.open(path, "w") as tar:
        tar.add(__file__, "notes.txt")
    with pytest.raises(StoreError, match="a tar, but not one that `skill export` wrote"):
        import_file(store, path)


def test_nothing_may_stand_behind_the_end_of_an_export(store: Store, make: Make, tmp_path: Path) -> None:
    path = tmp_path / "run.tar"
    export(store, store.write(make()).id, path)
    for more in (b"something", bytes(1 << 15)):
        changed = tmp_path / "changed.tar"
        changed.write_bytes(path.read_bytes() + more)
        with pytest.raises(StoreError, match="does not end as an export does"):
            import_file(Store(tmp_path / "other"), changed)
