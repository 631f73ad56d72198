"""A shared store: uploads and downloads that may be killed, doubled or lied to; nothing half there, nothing overwritten."""

from __future__ import annotations

import errno
import hashlib
import multiprocessing
import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from skillcli.errors import StoreError, UsageError
from skillcli.store import ArtifactId, Draft, Files, Store, download, open_remote, receive, remote_fsspec, upload
from skillcli.store.quarantine import MAX_FILE_BYTES
from skillcli.store.remote_files import LocalFiles
from skillcli.store.remote_index import LAYOUT, Catalog, Entry, claim
from tests.store import servers

pytestmark = pytest.mark.slow

Make = Callable[..., Draft]


@pytest.fixture(scope="module")
def bucket() -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch, servers.s3(patch) as client:
        yield client


@pytest.fixture(params=["file", "s3"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "file":
        return f"file://{tmp_path}/remote"
    request.getfixturevalue("bucket")
    return f"s3://group/{tmp_path.name}"


@pytest.fixture
def line(store: Store, make: Make) -> list[ArtifactId]:
    """A chain of three and a stranger; ancestors first."""
    store.write(make("pretrain", name="stranger", seed=9))
    first = store.write(make("pretrain")).id
    second = store.write(make("embed-means", parents=[first])).id
    return [first, second, store.write(make("compose", name="plan", parents=[second])).id]


@pytest.fixture
def other(tmp_path: Path) -> Store:
    return Store(tmp_path / "other")


@pytest.fixture
def files(tmp_path: Path) -> LocalFiles:
    return LocalFiles(tmp_path / "remote", "file:///remote")


def text(ids: list[ArtifactId]) -> list[str]:
    return [str(one) for one in ids]


def whole(store: Store) -> bool:
    return not any(store.verify_all().values())


def untouched(files: Files, store: Store) -> None:
    """Every visible artifact is whole, with all its ancestors."""
    catalog = Catalog.of(files)
    assert not catalog.strangers
    for entry in catalog.entries:
        data = files.read(entry.object, entry.bytes)
        assert data is not None and hashlib.sha256(data).hexdigest() == entry.sha256
        assert all(catalog.find(p.id, p.content_sha256) for p in store.header(entry.id).parents)


def test_artifacts_go_and_come_with_their_ancestors(address: str, store: Store, other: Store, line: list[ArtifactId]) -> None:
    files = open_remote(address)
    sent = upload(store, files, [line[-1]])
    assert (sent.transferred, sent.skipped, sent.renamed) == (line, [], {})
    assert sent.bytes == sum(store.path(one).stat().st_size for one in line)
    assert sorted(entry.id for entry in Catalog.of(files).entries) == sorted(line)
    again = upload(store, files, [line[-1], line[0]])
    assert (again.transferred, again.skipped, again.bytes) == ([], line, 0)
    got = download(other, files, ["plan/compose"])
    assert (got.transferred, got.skipped, got.renamed) == (line, [], {})
    assert other.ids() == sorted(line) and whole(other)
    assert all(other.path(one).read_bytes() == store.path(one).read_bytes() for one in line)
    assert download(other, files, ["plan/compose-v1"]).skipped == [line[-1]]
    assert not list(other.root.glob(".tmp*"))


def test_ids_that_other_content_has_are_not_taken_on_either_side(
    address: str, store: Store, other: Store, make: Make, line: list[ArtifactId], tmp_path: Path
) -> None:
    files = open_remote(address)
    mine = other.write(make("pretrain", seed=5)).id
    child = other.write(make("embed-means", parents=[mine])).id
    upload(store, files, [line[-1]])
    before = {entry.name for entry in Catalog.of(files).entries}
    sent = upload(other, files, [child])
    renamed = {one: replace(one, version=2) for one in (mine, child)}
    assert (sent.transferred, sent.renamed) == ([mine, child], renamed)
    assert upload(other, files, [child]).renamed == renamed and not upload(other, files, [child]).transferred
    assert before < {entry.name for entry in Catalog.of(files).entries}
    third = Store(tmp_path / "third")
    download(third, files, text([*line, renamed[child]]))
    assert third.ids() == sorted([*line, *renamed.values()]) and whole(third)
    assert third.header(renamed[child]).content_sha256 == other.header(child).content_sha256
    got = download(other, files, [str(line[-1])])
    assert got.renamed == {line[0]: replace(line[0], version=2), line[1]: replace(line[1], version=2)}
    assert len(other.ids()) == 5 and whole(other) and other.header(mine).content_sha256 != store.header(mine).content_sha256


def _race(address: str, root: Path, wanted: list[ArtifactId], start: Any) -> None:
    start.wait()
    upload(Store(root), open_remote(address), wanted)


def test_two_uploads_at_once_make_one_copy_and_give_an_id_once(
    address: str, store: Store, other: Store, make: Make, line: list[ArtifactId], tmp_path: Path
) -> None:
    rival = other.write(make("pretrain", seed=5)).id  # the same id, other content
    spawn = multiprocessing.get_context("spawn")
    start = spawn.Event()
    jobs = [(store.root, [line[-1]]), (store.root, [line[-1]]), (other.root, [rival])]
    racing = [spawn.Process(target=_race, args=(address, root, wanted, start)) for root, wanted in jobs]
    for one in racing:
        one.start()
    start.set()
    for one in racing:
        one.join(120)
        assert one.exitcode == 0
    entries = Catalog.of(open_remote(address)).entries
    assert len(entries) == len({entry.id for entry in entries}) == 4
    assert {e.content_sha256 for e in entries} == {
        s.header(o).content_sha256 for s, o in [(other, rival), *((store, i) for i in line)]
    }
    third = Store(tmp_path / "third")
    download(third, open_remote(address), [str(entry.id) for entry in entries])
    assert len(third.ids()) == 4 and whole(third)


def _killed(work: Callable[[], object], seconds: float) -> bool:
    """Do the work in a process that is killed after so long; return whether it was done before."""
    child = os.fork()
    if not child:
        work()
        os._exit(0)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_killed_at_any_moment_both_sides_are_whole_and_go_on(files: LocalFiles, store: Store, other: Store, make: Make) -> None:
    for seed in range(4):
        parent = store.write(make("pretrain", name=f"r{seed}", seed=seed)).id
        store.write(make("embed-means", name=f"r{seed}", parents=[parent], seed=seed))
    ids = store.ids()
    chance = random.Random(0)
    for _ in range(4):
        _killed(lambda: upload(store, files, ids), chance.uniform(0.0, 0.1))
        untouched(files, store)
    upload(store, files, ids)
    untouched(files, store)
    assert sorted(entry.id for entry in Catalog.of(files).entries) == ids
    assert not list(files.root.rglob(".tmp*"))
    for _ in range(4):
        _killed(lambda: download(other, files, text(ids)), chance.uniform(0.0, 0.3))
        assert whole(other) and set(other.ids()) <= set(ids)
    download(other, files, text(ids))
    assert other.ids() == ids and whole(other)


def test_a_claim_of_a_killed_upload_or_download_is_found_again(
    files: LocalFiles, store: Store, other: Store, line: list[ArtifactId]
) -> None:
    content = store.header(line[0]).content_sha256
    assert files.create(claim(line[0]), content.encode()) and not files.create(claim(line[0]), b"other")
    assert upload(store, files, [line[0]]).renamed == {}
    assert receive._claim(other, line[0], content) == line[0]  # and then killed
    assert download(other, files, [str(line[0])]).renamed == {}
    other.remove(line[0])
    assert download(other, files, [str(line[0])]).renamed == {}, "the same content gets its id again"


def damage(files: LocalFiles, entry: Entry, change: Callable[[bytes], bytes]) -> None:
    path = files.root / entry.object
    path.write_bytes(change(path.read_bytes()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "its bytes have changed"),
        (lambda data: data[:-1], "fewer than the"),
        (lambda data: data + b"x", "more than the"),
        (lambda data: b"", "fewer than the"),
    ],
)
def test_a_damaged_file_is_refused_named_and_can_be_replaced(
    files: LocalFiles, store: Store, other: Store, line: list[ArtifactId], change: Callable[[bytes], bytes], message: str
) -> None:
    upload(store, files, [line[-1]])
    entry = Catalog.of(files).pick("run/pretrain")
    damage(files, entry, change)
    with pytest.raises(StoreError, match=message) as caught:
        download(other, files, ["plan"])
    assert other.ids() == [] and not list(other.root.glob(".tmp*"))
    assert entry.object in caught.value.hint and "skill upload" in caught.value.hint
    (files.root / entry.object).unlink()
    with pytest.raises(StoreError, match="missing at"):
        download(other, files, ["plan"])
    assert upload(store, files, [line[-1]]).transferred == [line[0]]
    assert len(download(other, files, ["plan"]).transferred) == 3


def planted(files: LocalFiles, entry: Entry, data: bytes, **changes: Any) -> None:
    """Put a file there, with an index that fits it except for the changes."""
    files.write(replace(entry, sha256=hashlib.sha256(data).hexdigest(), bytes=len(data)).object, data)
    lie = replace(entry, **{"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), **changes})
    files.write(lie.name, b"")


@pytest.fixture
def honest(files: LocalFiles, store: Store, line: list[ArtifactId]) -> tuple[Entry, bytes]:
    """An entry and its file, of an otherwise empty shared store."""
    upload(store, files, [line[0]])
    entry = Catalog.of(files).pick(str(line[0]))
    data = (files.root / entry.object).read_bytes()
    shutil.rmtree(files.root)
    return entry, data


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"content_sha256": "0" * 64}, "its index says 000000000000"),
        ({"id": ArtifactId("run", "pretrain", 7)}, "holds pretrain 'run/pretrain-v1'"),
        ({"id": ArtifactId("else", "embed-means", 1)}, "holds pretrain 'run/pretrain-v1'"),
        ({"sha256": "0" * 64}, "is missing at"),
        ({"bytes": 100}, "more than the 100 bytes"),
        ({"bytes": 10**10}, f"at most {MAX_FILE_BYTES} are read"),
    ],
)
def test_an_index_that_lies_is_refused(
    files: LocalFiles, other: Store, honest: tuple[Entry, bytes], changes: dict[str, Any], message: str
) -> None:
    planted(files, *honest, **changes)
    with pytest.raises(StoreError, match=message) as caught:
        download(other, files, [str(changes.get("id", honest[0].id))])
    assert "\n" not in caught.value.message
    assert other.ids() == [] and not list(other.root.glob(".tmp*"))


def test_hostile_files_are_refused_before_they_get_a_name(
    files: LocalFiles, other: Store, honest: tuple[Entry, bytes], tmp_path: Path
) -> None:
    entry, data = honest
    for bad in (
        b"\x89HDF\r\n\x1a\n" + bytes(5000),
        data[: len(data) // 2],
        b"#!/bin/sh\n",
        data[:5000] + bytes(len(data) - 5000),
    ):
        planted(files, entry, bad)
        with pytest.raises(StoreError):
            download(other, files, [str(entry.id)])
        assert other.ids() == [] and not list(other.root.glob(".tmp*"))
        shutil.rmtree(files.root)


def test_names_that_are_no_entries_are_left_alone(files: LocalFiles, other: Store, honest: tuple[Entry, bytes]) -> None:
    planted(files, *honest)
    good = honest[0].name.rpartition("/")[2]
    for name in ("../../../away/" + good, "run/" + good.replace("pretrain", "unknown"), f"run/{good}.x", "run/note.txt"):
        files.write(f"{LAYOUT}/index/{name}", b"")
    catalog = Catalog.of(files)
    assert [entry.id for entry in catalog.entries] == [honest[0].id] and len(catalog.strangers) == 3
    assert download(other, files, ["run/pretrain"]).transferred == [honest[0].id]


def test_an_id_with_two_contents_is_not_chosen_from(files: LocalFiles, other: Store, honest: tuple[Entry, bytes]) -> None:
    planted(files, *honest)
    files.write(replace(honest[0], content_sha256="0" * 64).name, b"")
    with pytest.raises(StoreError, match="more than one content"):
        download(other, files, ["run/pretrain"])


def test_a_child_whose_parent_is_gone_is_refused(files: LocalFiles, store: Store, other: Store, line: list[ArtifactId]) -> None:
    upload(store, files, [line[-1]])
    (files.root / Catalog.of(files).pick(str(line[0])).name).unlink()
    with pytest.raises(StoreError, match="was made from run/pretrain-v1, which is neither at"):
        download(other, files, ["plan"])
    assert other.ids() == []


def test_a_damaged_artifact_is_not_sent(files: LocalFiles, store: Store, line: list[ArtifactId]) -> None:
    data = bytearray(store.path(line[0]).read_bytes())
    data[-1] ^= 1
    store.path(line[0]).write_bytes(data)
    with pytest.raises(StoreError, match="cannot upload run/pretrain-v1"):
        upload(store, files, [line[-1]])
    assert Catalog.of(files).entries == []


def test_what_comes_back_otherwise_than_it_was_sent_is_not_shown(
    files: LocalFiles, store: Store, line: list[ArtifactId], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = files.write
    monkeypatch.setattr(files, "write", lambda name, data: write(name, data[:-1] if "objects" in name else data))
    with pytest.raises(StoreError, match="differs from what was sent"):
        upload(store, files, [line[0]])
    assert Catalog.of(files).entries == []


def test_sftp_keeps_the_same_promises(
    store: Store, other: Store, line: list[ArtifactId], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    known = tmp_path / "home/.ssh/known_hosts"
    with servers.sftp(known) as start:
        files = open_remote(f"{start}{tmp_path}/remote")
        assert "secret" not in files.address
        assert upload(store, files, [line[-1]]).transferred == line
        assert upload(store, files, [line[-1]]).skipped == line
        assert not files.create(claim(line[0]), b"other") and files.read(claim(line[0]), 64) != b"other"
        assert not list((tmp_path / "remote").rglob(".tmp*"))
        assert download(other, files, ["plan"]).transferred == line and whole(other)
        known.write_text("")
        with pytest.raises(StoreError, match="known_hosts: connect once"):
            open_remote(f"{start}{tmp_path}/remote")


@pytest.mark.parametrize(
    ("address", "message", "hint"),
    [
        ("/mnt/group", "expected an address", "did you mean file:///mnt/group?"),
        ("ftp://host/folder", "expected an address", "choose one"),
        ("s3://", "expected an address", "s3://BUCKET/PATH"),
        ("", "expected an address", "one of"),
    ],
)
def test_other_addresses_are_refused(address: str, message: str, hint: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        open_remote(address)
    assert hint in caught.value.hint


def test_a_missing_package_is_named() -> None:
    scheme = replace(remote_fsspec.SCHEMES["gs"], package="gcsfs")
    pytest.importorskip("fsspec")
    try:
        import gcsfs  # noqa: F401
    except ImportError:
        with pytest.raises(StoreError, match="needs the package gcsfs") as caught:
            remote_fsspec.FsspecFiles("gs://group/x", scheme)
        assert caught.value.hint == "pip install 'skillcli[gs]'"


def test_what_refuses_is_said_in_one_line(
    bucket: Any, store: Store, line: list[ArtifactId], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_fsspec, "_PAUSE_SECONDS", 0.01)
    said = {}
    for case, address in (("empty", "s3://group/none"), ("bucket", "s3://nobucket/x"), ("folder", f"file://{tmp_path}/a/b")):
        with pytest.raises(StoreError) as caught:
            if case == "empty":
                download(store, open_remote(address), ["x"])
            upload(store, open_remote(address), [line[0]])
        said[case] = caught.value
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    with pytest.raises(StoreError) as caught:
        open_remote("s3://group/x").names("index")
    said["network"] = caught.value
    assert "there are no artifacts at s3://group/none" in said["empty"].message
    assert "does not exist" in said["bucket"].message and "there is no folder" in said["folder"].message
    assert "check the address and the network" in said["network"].hint
    assert not any("\n" in error.message for error in said.values())


def test_the_same_run_from_two_machines_is_one_artifact(files: LocalFiles, store: Store, other: Store, make: Make) -> None:
    one, same = store.write(make("pretrain")), other.write(make("pretrain"))
    assert one.content_sha256 == same.content_sha256
    assert store.path(one.id).read_bytes() != other.path(one.id).read_bytes(), "made at another time"
    before = Catalog.of(files)
    upload(store, files, [one.id])
    with pytest.MonkeyPatch.context() as patch:  # the second looked before the first had finished
        patch.setattr(Catalog, "of", lambda _: before)
        assert upload(other, files, [one.id]).renamed == {}
    assert len(files.names(f"{LAYOUT}/index")) == 2 and len(Catalog.of(files).entries) == 1


def test_a_full_disk_is_named_on_either_side(
    files: LocalFiles, store: Store, other: Store, line: list[ArtifactId], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match="No space left") as caught:
        upload(store, files, [line[0]])
    assert "the disk of the shared store is full" in caught.value.hint
    assert Catalog.of(files).entries == [] and not list(files.root.rglob(".tmp*"))
    monkeypatch.undo()
    upload(store, files, [line[0]])
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match="No space left") as caught:
        download(other, files, ["run/pretrain"])
    assert "--store" in caught.value.hint and other.ids() == [] and not list(other.root.rglob(".tmp*"))


def test_a_network_that_fails_is_tried_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote_fsspec, "_PAUSE_SECONDS", 0.0)
    files = remote_fsspec.FsspecFiles("memory://group", remote_fsspec.Scheme("fsspec", "none", "none"))
    files.write("index/a", b"")
    assert files.create("claims/a", b"1") and not files.create("claims/a", b"2") and files.read("claims/a", 9) == b"1"
    find, failures = files._fs.find, [ConnectionResetError(104, "reset")] * (remote_fsspec.ATTEMPTS - 1)

    def shaky(path: str) -> Any:
        if failures:
            raise failures.pop()
        return find(path)

    monkeypatch.setattr(files._fs, "find", shaky)
    assert files.names("index") == ["index/a"]
    failures += [ConnectionResetError(104, "reset")] * remote_fsspec.ATTEMPTS
    with pytest.raises(StoreError, match=r"cannot list memory://group: .*reset"):
        files.names("index")
    assert not failures
