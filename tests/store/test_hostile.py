"""Files that somebody damaged, or made to do harm: refused in one line, before their data is read."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped,unused-ignore]
import numpy as np
import pytest

from skillcli.errors import StoreError
from skillcli.store import ArtifactId, Draft, Store, block

pytestmark = pytest.mark.slow

Make = Callable[..., Draft]


@pytest.fixture
def artifact(store: Store, make: Make) -> ArtifactId:
    return store.write(make()).id


def reseal(path: Path, change: Callable[[dict[str, Any]], None] = lambda _: None) -> None:
    """Give a tampered file the size and hash it would have if it were honest."""
    data = io.BytesIO(path.read_bytes())
    header, size = block.read_block(data)
    header["bytes"] = data.getbuffer().nbytes
    change(header)
    block.seal(data, header, size)
    path.write_bytes(data.getvalue())


def refused(store: Store, artifact: ArtifactId) -> str:
    """The one line with which reading and verifying refuse it."""
    with pytest.raises(StoreError) as caught:
        store.read(artifact)
    assert store.verify(artifact) == [caught.value.message]
    assert "\n" not in caught.value.message
    return caught.value.message


def test_a_flip_of_any_bit_is_reported(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    good = path.read_bytes()
    rng = random.Random(0)
    everywhere = [rng.randrange(8 * len(good)) for _ in range(300)]
    in_the_header = [rng.randrange(8 * 700) for _ in range(200)]
    for bit in everywhere + in_the_header:
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        path.write_bytes(bad)
        assert len(store.verify(artifact)) == 1, f"bit {bit} was not noticed"


def test_a_truncated_or_extended_file_is_reported(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    good = path.read_bytes()
    for length in (0, 1, 50, 300, 4095, 4096, 5000, len(good) // 2, len(good) - 1):
        path.write_bytes(good[:length])
        assert len(store.verify(artifact)) == 1
    path.write_bytes(good + b"\0")
    assert "bytes" in refused(store, artifact)


def test_damage_behind_a_valid_hash_is_refused(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    good = path.read_bytes()
    rng = random.Random(1)
    for _ in range(150):
        bad = bytearray(good)
        for _ in range(8):
            bad[rng.randrange(4096, len(good))] = rng.randrange(256)
        path.write_bytes(bad)
        reseal(path)
        assert store.verify(artifact) != []


def _soft_link(file: h5py.File) -> None:
    del file["skills/goal"]
    file["skills/goal"] = h5py.SoftLink("/embedding/mean")


def _external_link(file: h5py.File) -> None:
    del file["skills"]
    file["skills"] = h5py.ExternalLink("other.h5", "/skills")


def _hard_link(file: h5py.File) -> None:
    file["trajectories/again"] = file["trajectories/time"]


def _cycle(file: h5py.File) -> None:
    file["trajectories/self"] = file["trajectories"]


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((5, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (5, 3))
    del file["skills/goal"]
    file.create_virtual_dataset("skills/goal", layout)


def _external_storage(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", (5, 3), "f8", external=[("/etc/passwd", 0, 120)])


def _huge(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", (5, 1 << 30), "f8")


def _huge_chunked(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", (1 << 20, 1 << 10), "f8", chunks=(1, 1 << 10), compression="gzip")


def _unstored(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", (5, 3), "f8")


def _growing(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", data=np.zeros((5, 3)), maxshape=(None, 3))


def _bomb(file: h5py.File) -> None:
    """One chunk of 120 bytes that unpacks to 64 MiB."""
    del file["skills/goal"]
    goal = file.create_dataset("skills/goal", (5, 3), "f8", chunks=(5, 3), compression="gzip")
    goal.id.write_direct_chunk((0, 0), zlib.compress(bytes(1 << 26), 9))


def _other_filter(file: h5py.File) -> None:
    del file["skills/goal"]
    file.create_dataset("skills/goal", data=np.zeros((5, 3)), compression="lzf")


def _objects(file: h5py.File) -> None:
    file["skills"].create_dataset("text", data=["a", "b"], dtype=h5py.string_dtype())


def _compound(file: h5py.File) -> None:
    file["skills"].create_dataset("pair", data=np.zeros(3, [("a", "f8"), ("b", "i4")]))


def _named_type(file: h5py.File) -> None:
    file["skills/type"] = np.dtype("f8")


def _array_attribute(file: h5py.File) -> None:
    file["skills/goal"].attrs["many"] = np.arange(5)


def _group_attribute(file: h5py.File) -> None:
    file["skills"].attrs["one"] = np.int64(5)


def _unsigned_seed(file: h5py.File) -> None:
    file.attrs.create("seed", np.uint64(0))


def _false_dimensions(file: h5py.File) -> None:
    file["skills/goal"].attrs.create("dimensions", np.bytes_(b"skill"), dtype=h5py.string_dtype("utf-8", 5))


def _further_attribute(file: h5py.File) -> None:
    file["skills/goal"].attrs.create("scale", np.int64(2))


def _long_text_attribute(file: h5py.File) -> None:
    file["skills/goal"].attrs["note"] = "of variable length"


def _not_utf8(file: h5py.File) -> None:
    file.attrs.create("git_commit", np.bytes_(b"\xff\xfe"), dtype=h5py.string_dtype("utf-8", 2))


def _odd_name(file: h5py.File) -> None:
    file["skills"].create_dataset("..\u202e", data=np.zeros(3))


def _many(file: h5py.File) -> None:
    for i in range(1001):
        file.create_group(f"skills/{i}")


def _attribute_differs(file: h5py.File) -> None:
    file.attrs["seed"] = np.int64(5)


def _no_record(file: h5py.File) -> None:
    del file["record/recipe"]


def _other_recipe(file: h5py.File) -> None:
    text = file["record/recipe"][()].tobytes().replace(b"0.001", b"0.002")
    file["record/recipe"][...] = np.frombuffer(text, np.uint8)


def _much_json(file: h5py.File) -> None:
    _put_results(file, b"[" + b"[]," * (1 << 21))


def _put_results(file: h5py.File, text: bytes) -> None:
    del file["record/results"]
    results = file["record"].create_dataset("results", data=np.frombuffer(text, np.uint8), compression="gzip")
    for name, label in (("dimensions", b"byte"), ("unit", b"JSON")):
        results.attrs.create(name, np.bytes_(label), dtype=h5py.string_dtype("utf-8", 4))


def _bad_json(file: h5py.File) -> None:
    file["record/results"][0] = 0xFF


HOSTILE: dict[Callable[[h5py.File], None], str] = {
    _soft_link: "skills/goal is a link",
    _external_link: "skills is a link",
    _hard_link: "second name",
    _cycle: "second name",
    _virtual: "is a virtual dataset",
    _external_storage: "in another file",
    _huge: "declares",
    _huge_chunked: "declares",
    _unstored: "declares data that is not stored",
    _growing: "no fixed shape",
    _bomb: "does not unpack",
    _other_filter: "packed in a way",
    _objects: "neither integers",
    _compound: "neither integers",
    _named_type: "neither a group nor a dataset",
    _array_attribute: "not a single value",
    _group_attribute: "the group skills/ has attributes",
    _unsigned_seed: "neither a signed integer",
    _false_dimensions: "dimensions named 'skill'",
    _further_attribute: "must have the attributes dimensions and unit",
    _long_text_attribute: "neither a signed integer of 64 bits nor a text",
    _not_utf8: "cannot read",
    _odd_name: "not a path",
    _many: "more than 1000 objects",
    _attribute_differs: "disagree about seed",
    _no_record: "lacks record/recipe",
    _other_recipe: "disagree about recipe",
    _much_json: "bytes of JSON",
    _bad_json: "cannot read",
}


def _bomb_of_zeros(file: h5py.File) -> None:
    """As much as is ever read of a small file, packed as tightly as gzip can; wrong only in what it means."""
    file["embedding"].create_dataset("more", data=np.zeros(44 << 20, np.uint8), chunks=(1 << 20,), compression="gzip")


def _many_chunks(file: h5py.File) -> None:
    file["embedding"].create_dataset("more", data=np.zeros(3900, np.uint8), chunks=(1,), compression="gzip")


def _many_objects(file: h5py.File) -> None:
    for i in range(950):
        item = file.create_dataset(f"embedding/more{i}", data=np.zeros(1))
        for j in range(8):
            item.attrs.create(f"a{j}", np.int64(j))


def _wide_json(file: h5py.File) -> None:
    _put_results(file, b'{"a":[' + b"[]," * 330_000 + b"0]}")


LARGE = (_bomb_of_zeros, _many_chunks, _many_objects, _wide_json)
"""Files at the limits of what is looked at: the most that a hostile one can cost."""

MEASURED = """
import json, resource, sys, time
from pathlib import Path
from skillcli.errors import StoreError
from skillcli.store import Store
store = Store(Path(sys.argv[1]))
worst, accepted, slowest = 0.0, [], None
for one in store.ids():
    started = time.process_time()
    if not store.verify(one):
        accepted.append(str(one))
    seconds = time.process_time() - started
    if seconds > worst:
        worst, slowest = seconds, str(one)
try:  # of this program alone: ru_maxrss also counts what the forking parent held
    status = open("/proc/self/status").read()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
except OSError:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps({"seconds": worst, "slowest": slowest, "megabytes": peak, "accepted": accepted}))
"""


@pytest.mark.parametrize("tamper", HOSTILE, ids=lambda function: function.__name__)
def test_hostile_contents_are_refused(store: Store, artifact: ArtifactId, tamper: Callable[[h5py.File], None]) -> None:
    path = store.path(artifact)
    with h5py.File(path, "r+") as file:
        tamper(file)
    reseal(path)
    assert HOSTILE[tamper] in refused(store, artifact)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 0}, "has schema 0"),
        ({"schema_version": "1"}, "not that of an artifact"),
        ({"kind": "other"}, "unknown kind, 'other'"),
        ({"kind": "compose"}, "holds compose"),
        ({"id": "else/embed-means-v1"}, "holds embed-means 'else/embed-means-v1'"),
        ({"id": "../../etc/passwd"}, "holds embed-means '../../etc/passwd'"),
        ({"parents": [{"id": "../x", "content_sha256": "0" * 64}]}, "not an artifact id"),
        ({"parents": [{"id": "x/pretrain-v1", "content_sha256": "0"}]}, "not a SHA-256"),
        ({"parents": [{"id": "run/embed-means-v1", "content_sha256": "0" * 64}]}, "made from itself"),
        ({"parents": [3]}, "not given by id and content hash"),
        ({"created_utc": "yesterday"}, "its creation time is not a UTC time"),
        ({"created_utc": "9999-01-01T00:00:00.000000+00:00"}, "its creation time is not a UTC time"),
        ({"created_utc": "2026-02-30T00:00:00.000000+00:00"}, "cannot read"),
        ({"recipe_name": "n" * 200}, "its recipe name is not one of at most"),
        ({"inputs_sha256": "none"}, "hash of inputs"),
        ({"seed": 2**63}, "its seed is not between 0 and 2**63 - 1"),
        ({"seed": -1}, "its seed is not between 0 and 2**63 - 1"),
        ({"content_sha256": "short"}, "content hash"),
        ({"surprise": 1}, "not that of an artifact"),
    ],
)
def test_headers_that_are_not_ours_are_refused(
    store: Store, artifact: ArtifactId, change: dict[str, Any], message: str
) -> None:
    reseal(store.path(artifact), lambda header: header.update(change))
    assert message in refused(store, artifact)
    assert message in store.listing().unreadable[0].problem


def test_a_header_that_names_another_recipe_is_refused(store: Store, artifact: ArtifactId) -> None:
    reseal(store.path(artifact), lambda header: header.update(recipe_name="other"))
    assert "names the recipe 'other', inside it is another" in refused(store, artifact)


def test_a_thousand_parents_are_refused(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    data = io.BytesIO(path.read_bytes())
    header, size = block.read_block(data)
    header["parents"] = [{"id": f"x/pretrain-v{n + 1}", "content_sha256": "0" * 64} for n in range(1000)]
    grown = block.LARGEST
    longer = io.BytesIO(bytes(grown) + data.getvalue()[size:])
    block.seal(longer, {**header, "bytes": len(longer.getvalue())}, grown)
    path.write_bytes(longer.getvalue())
    assert "1000 parents, at most 256" in store.listing().unreadable[0].problem
    refused(store, artifact)


def test_nothing_may_lie_behind_the_hdf5_part(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    path.write_bytes(path.read_bytes() + b"more")
    reseal(path)
    assert "something lies behind its HDF5 part" in refused(store, artifact)


def test_a_false_content_hash_is_found_by_verify(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    with h5py.File(path, "r+") as file:
        file["embedding/mean"][0, 0] += 1
    reseal(path)
    assert store.verify(artifact) == [f"the content hash of {artifact} is not that of its content"]


@pytest.mark.parametrize("text", ["[]", "[" * 3000, '{"seed": NaN}', '{"seed": ' + "9" * 3500 + "}", "{"])
def test_header_json_made_to_confuse_is_refused(store: Store, artifact: ArtifactId, text: str) -> None:
    path = store.path(artifact)
    data = path.read_bytes()
    start = data.index(b"\n") + 1
    path.write_bytes(data[:start] + f"{text}\n".encode().ljust(4096 - start, b"\0") + data[4096:])
    refused(store, artifact)


def test_what_is_not_a_file_is_refused(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    path.unlink()
    os.mkfifo(path)
    assert "not a file" in refused(store, artifact)
    path.unlink()
    path.mkdir()
    assert "not a file" in refused(store, artifact)
    path.rmdir()
    path.symlink_to("nowhere")
    assert "No such file" in refused(store, artifact)


def test_a_huge_sparse_file_is_refused_by_its_header(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    with path.open("r+b") as file:
        file.truncate(1 << 40)
    assert "were written" in refused(store, artifact)


def test_a_superblock_that_points_behind_the_end_is_refused(store: Store, artifact: ArtifactId) -> None:
    path = store.path(artifact)
    data = bytearray(path.read_bytes())
    data[4096 + 28 : 4096 + 36] = struct.pack("<Q", 1 << 60)
    path.write_bytes(data)
    reseal(path)
    refused(store, artifact)


def test_the_block_is_strict_json_that_any_tool_reads(store: Store, artifact: ArtifactId) -> None:
    lines = store.path(artifact).read_bytes()[:4096].split(b"\n")
    assert json.loads(lines[1])["id"] == str(artifact)
    assert not lines[2].strip(b"\0")


def test_every_hostile_file_is_refused_quickly_and_in_little_memory(store: Store, artifact: ArtifactId, tmp_path: Path) -> None:
    """One process meets them all, as `skill verify` would, and tells its slowest and its largest moment."""
    good = store.path(artifact).read_bytes()
    for number, tamper in enumerate([*HOSTILE, *LARGE]):
        path = tmp_path / f"hostile/run{number}/{artifact.stage}-v1.h5"
        path.parent.mkdir(parents=True)
        path.write_bytes(good)
        with h5py.File(path, "r+") as file:
            tamper(file)
        reseal(path, lambda header, name=path.parent.name: header.update(id=f"{name}/{artifact.stage}-v1"))  # type: ignore[misc]
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, str(tmp_path / "hostile")], capture_output=True, text=True, check=True
    )
    worst = json.loads(done.stdout)
    assert worst["accepted"] == []
    assert worst["seconds"] < 2.0 and worst["megabytes"] < 200, worst
