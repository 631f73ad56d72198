# ruff: noqa: E501 - tables of one case a line
"""What is handed to `import` and is no artifact, or an export that lies."""

from __future__ import annotations

import gzip
import hashlib
import io
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from typing import Any

import h5py

from .case import add, case
from .forge import canonical
from .good import CHAIN, NAME, Good

Member = tuple[str, bytes]
MANIFEST = "manifest.json"


def head(name: str | bytes, count: int, kind: bytes = b"0", **fields: bytes) -> bytes:
    """A header of a tar, its sum right; `fields` replaces size, link or prefix byte by byte."""
    name = name if isinstance(name, bytes) else name.encode()
    size_field = fields.get("size", b"%011o\0" % max(0, count))
    block = bytearray(512)
    block[0 : len(name[:100])] = name[:100]
    block[100:108], block[108:116], block[116:124] = b"0000644\0", b"0000000\0", b"0000000\0"
    block[124 : 124 + len(size_field)], block[136:148] = size_field, b"00000000000\0"
    block[156:157], block[257:265] = kind, b"ustar\00000"
    block[157 : 157 + len(fields.get("link", b""))] = fields.get("link", b"")
    block[345 : 345 + len(fields.get("prefix", b""))] = fields.get("prefix", b"")
    block[148:156] = b" " * 8
    block[148:156] = b"%06o\0 " % sum(block)
    return bytes(block)


def whole(name: str | bytes, data: bytes, kind: bytes = b"0", **fields: bytes) -> bytes:
    return head(name, len(data), kind, **fields) + data + bytes(-len(data) % 512)


def tar(members: Sequence[Member], end: bytes = bytes(1024)) -> bytes:
    return b"".join(whole(name, data) for name, data in members) + end


def entry(one: str, data: bytes, content: str, **changes: Any) -> dict[str, Any]:
    told = {"id": one, "content_sha256": content, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    return {key: value for key, value in (told | changes).items() if value is not None}


def parts(good: Good) -> list[tuple[str, bytes, str]]:
    """Two artifacts, the second made from the first, under names that are not in the store: id, file, content."""
    first, second = good.forged(), good.forged("embed-means")
    second.header["parents"][0]["id"] = first.header["id"]
    return [(copy.header["id"], copy.file(), copy.header["content_sha256"]) for copy in (first, second)]


def told(entries: list[Any], **changes: Any) -> bytes:
    return canonical({"format": "skill-export", "version": 1, "artifacts": entries} | changes).encode()


def export(change: Callable[[list[Member], list[Any]], object] = lambda *_: None, **manifest: Any) -> Callable[[Good], bytes]:
    """A good export after a change of its members or of what the manifest lists."""

    def build(good: Good) -> bytes:
        artifacts = parts(good)
        members = [(f"{one}.h5", data) for one, data, _ in artifacts]
        entries: list[Any] = [entry(*artifact) for artifact in artifacts]
        change(members, entries)
        return tar([(MANIFEST, told(entries, **manifest)), *members])

    return build


def around(change: Callable[[bytes], bytes]) -> Callable[[Good], bytes]:
    return lambda good: change(export()(good))


def said(number: int = 1, **changes: Any) -> Callable[[Good], bytes]:
    """An entry of the manifest says so."""
    return export(lambda _, entries: entries.__setitem__(number, {**entries[number], **changes}))


def member(number: int, change: Callable[[Member], Member]) -> Callable[[Good], bytes]:
    return export(lambda members, _: members.__setitem__(number, change(members[number])))


def in_front(blocks: bytes) -> Callable[[Good], bytes]:
    return around(lambda data: blocks + data)


def behind_the_manifest(blocks: Callable[[bytes], bytes] | bytes) -> Callable[[Good], bytes]:
    def change(data: bytes) -> bytes:
        first = 512 + -(-int(data[124:135], 8) // 512) * 512
        return data[:first] + (blocks if isinstance(blocks, bytes) else blocks(data[first:])) + data[first:]

    return around(change)


def typed(kind: bytes, **fields: bytes) -> Callable[[Good], bytes]:
    """The first artifact's member is of another kind."""

    def build(good: Good) -> bytes:
        artifacts = parts(good)
        text = told([entry(*artifact) for artifact in artifacts])
        (first, data, _), (second, other, _) = artifacts
        return whole(MANIFEST, text) + whole(f"{first}.h5", data, kind, **fields) + tar([(f"{second}.h5", other)])

    return build


def copies(count: int) -> Callable[[Good], bytes]:
    """One artifact under so many versions."""

    def build(good: Good) -> bytes:
        copy, members, entries = good.forged("compose"), [], []
        copy.header["parents"] = []
        for version in range(1, count + 1):
            copy.header["id"] = one = f"{NAME}/compose-v{version}"
            data = copy.file()
            members.append((f"{one}.h5", data))
            entries.append(entry(one, data, copy.header["content_sha256"]))
        return tar([(MANIFEST, told(entries)), *members])

    return build


def trainings(count: int) -> Callable[[Good], bytes]:
    """So many good artifacts of which none was made from another."""

    def build(good: Good) -> bytes:
        copy, members, entries = good.forged(), [], []
        for version in range(1, count + 1):
            copy.header["id"] = one = f"{NAME}/pretrain-v{version}"
            copy.header["seed"] = version
            data = copy.file()
            members.append((f"{one}.h5", data))
            entries.append(entry(one, data, copy.header["content_sha256"]))
        return tar([(MANIFEST, told(entries)), *members])

    return build


def nested(depth: int) -> bytes:
    return whole(MANIFEST, b"[" * depth + b"]" * depth)


LONG = whole("././@LongLink", b"a" * 600, b"L")
PAX = whole("././@PaxHeader", b"20 path=hostile/x.h5", b"x")
for name, build in {
    "long_names_by_the_thousand": in_front(LONG * 20_000),
    "long_names_after_the_manifest": behind_the_manifest(LONG * 20_000),
    "long_name_of_a_gib": in_front(head("././@LongLink", 1 << 30, b"L")),
    "long_link_names": in_front(whole("././@LongLink", b"a" * 600, b"K") * 5000),
    "pax_headers_by_the_thousand": in_front(PAX * 20_000),
    "pax_headers_after_the_manifest": behind_the_manifest(PAX * 20_000),
    "pax_header_without_a_length": in_front(whole("x", b"x" * 500, b"x")),
    "pax_header_of_a_size": in_front(whole("x", b"22 size=9999999999999\n", b"x")),
    "pax_header_for_all": in_front(whole("x", b"20 path=hostile/x.h5", b"g")),
    "empty_members_by_the_hundred_thousand": behind_the_manifest(head("x", 0) * 100_000),
    "empty_members_in_front": in_front(head("x", 0) * 100_000),
    "gnu_sparse": typed(b"S"),
    "symbolic_link": typed(b"2", link=b"/etc/passwd"),
    "hard_link": typed(b"1", link=MANIFEST.encode()),
    "pipe": typed(b"6"),
    "device": typed(b"3"),
    "folder": typed(b"5"),
    "contiguous": typed(b"7"),
    "unknown_type": typed(b"Z"),
    "old_type": typed(b"\0"),
    "size_in_base_256": typed(b"0", size=b"\x80" + bytes(10) + b"\x10"),
    "size_in_base_256_below_zero": typed(b"0", size=b"\xff" * 12),
    "size_of_8_gib": typed(b"0", size=b"77777777777\0"),
    "size_that_is_no_number": typed(b"0", size=b"xyz"),
    "size_with_a_sign": typed(b"0", size=b"-0000000001\0"),
    "size_with_underscores": typed(b"0", size=b"0_0_0_1_0\0"),
    "size_of_nothing": typed(b"0", size=b"00000000000\0"),
    "name_with_a_prefix": typed(b"0", prefix=b"other"),
    "name_that_leaves": member(0, lambda m: ("../../etc/pretrain-v1.h5", m[1])),
    "name_that_is_absolute": member(0, lambda m: ("/tmp/pretrain-v1.h5", m[1])),
    "name_with_dots": member(0, lambda m: ("./" + m[0], m[1])),
    "name_of_escapes": member(0, lambda m: ("\x1b[2J" + m[0], m[1])),
    "name_of_markup": member(0, lambda m: ("[/]" + m[0], m[1])),
    "name_in_capitals": member(0, lambda m: (m[0].upper(), m[1])),
    "a_member_of_300_mib_of_zeros": export(lambda m, e: (m.append(("z/pretrain-v1.h5", bytes(300 << 20))), e.append(entry("z/pretrain-v1", m[-1][1], "0" * 64)))),
    "a_member_that_is_not_listed": export(lambda members, _: members.append(("more.h5", b"more"))),
    "a_member_missing": export(lambda members, _: members.pop()),
    "all_members_missing": export(lambda members, _: members.clear()),
    "a_member_twice": export(lambda members, _: members.append(members[0])),
    "a_member_and_its_entry_twice": export(lambda members, entries: (members.append(members[0]), entries.append(entries[0]))),
    "members_in_another_order": export(lambda members, _: members.reverse()),
    "child_before_its_parent": export(lambda members, entries: (members.reverse(), entries.reverse())),
    "parent_missing": export(lambda members, entries: (members.pop(0), entries.pop(0))),
    "a_member_cut_short": around(lambda data: data[: len(data) // 2]),
    "one_byte_flipped": around(lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:]),
    "something_behind_the_end": around(lambda data: data + b"more"),
    "another_export_behind_the_end": around(lambda data: data + data),
    "no_end": around(lambda data: data[:-1024]),
    "manifest_says_another_hash": said(sha256="0" * 64),
    "manifest_says_another_content": said(content_sha256="0" * 64),
    "manifest_says_fewer_bytes": said(bytes=100),
    "manifest_says_bytes_below_zero": said(bytes=-1),
    "manifest_says_a_gib_more": said(bytes=1 << 40),
    "manifest_says_bytes_in_fractions": said(bytes=1e3),
    "manifest_says_another_id": said(id="other/embed-means-v1"),
    "manifest_says_an_id_that_leaves": said(id="../../etc/pretrain-v1"),
    "manifest_says_an_id_of_markup": said(id="[/]"),
    "manifest_says_more": said(more=1),
    "manifest_lists_numbers": export(lambda _, entries: entries.append(3)),
    "manifest_lists_nothing": export(artifacts=[]),
    "manifest_lists_a_text": export(artifacts="[/]"),
    "manifest_lists_5000": export(lambda _, entries: entries.extend(entries[:1] * 2000)),
    "manifest_of_another_format": export(format="other"),
    "manifest_of_markup": export(format="[/]\x1b[2J"),
    "manifest_of_version_2": export(version=2),
    "manifest_of_version_true": export(version=True),
    "manifest_of_version_fractional": export(version=1.0),
    "manifest_of_version_markup": export(version="[/]\x1b[2J"),
    "manifest_with_more": export(more=1),
    "manifest_nested_900": lambda _: nested(900),
    "manifest_nested_100000": lambda _: nested(100_000),
    "manifest_of_2_mib": lambda _: whole(MANIFEST, b" " * (2 << 20)),
    "manifest_is_not_json": lambda _: whole(MANIFEST, b"\xff\xfe{"),
    "manifest_alone": lambda _: whole(MANIFEST, told([])),
    "manifest_last": export(lambda members, entries: members.append((MANIFEST, b"{}"))),
    "empty_file": lambda _: b"",
    "zeros": lambda _: bytes(10240),
    "text": lambda _: b"hello\n" * 100,
    "text_of_escapes": lambda _: b"\x1b[2J[/]" * 100,
    "plain_tar": lambda good: tar([("a.txt", b"a"), ("b.h5", good.data())]),
    "tar_gz": lambda good: gzip.compress(export()(good)),
    "artifact_gz": lambda good: gzip.compress(good.data()),
    "the_first_line_alone": lambda good: good.data()[:98],
    "the_magic_alone": lambda good: b"skill-store ",
}.items():  # fmt: skip
    add(f"archives.{name}", build, form="export")
add("archives.good", export(), "accepted", form="export")
add("archives.no_parent_300_times", copies(300), form="export")
add("archives.300_trainings", trainings(300), form="export")
add("archives.two_trainings", trainings(2), form="export")


@case(form="export")
def other_hdf5(_: Good) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["data"] = [1, 2, 3]
    return buffer.getvalue()


@case(form="export")
def other_hdf5_with_a_block(_: Good) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=4096) as file:
        file["data"] = [1, 2, 3]
    return buffer.getvalue()


@case(form="export")
def zip_of_an_artifact(good: Good) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("a.h5", good.data())
    return buffer.getvalue()


@case(form="export")
def tar_of_another_format(good: Good) -> bytes:
    """As `tar` packs a store's folder."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as file:
        file.add(good.root, CHAIN)
    return buffer.getvalue()


@case(form="export")
def parents_in_a_circle(good: Good) -> bytes:
    """Each says that it was made from the other; no hash can be right for both."""
    one, two = good.forged("compose"), good.forged("embed-means")
    one.header["parents"] = [{"id": two.header["id"], "content_sha256": "1" * 64}]
    two.header["parents"] = [{"id": one.header["id"], "content_sha256": "2" * 64}]
    files = [(copy.header["id"], copy.file(), copy.header["content_sha256"]) for copy in (one, two)]
    return tar([(MANIFEST, told([entry(*file) for file in files])), *((f"{one}.h5", data) for one, data, _ in files)])


@case(form="export")
def own_parent(good: Good) -> bytes:
    copy = good.forged("compose")
    copy.header["parents"] = [{"id": copy.header["id"], "content_sha256": "1" * 64}]
    data = copy.file()
    return tar(
        [(MANIFEST, told([entry(copy.header["id"], data, copy.header["content_sha256"])])), (f"{copy.header['id']}.h5", data)]
    )


@case(form="export")
def damaged_inside(good: Good) -> bytes:
    """An export whose hashes are right, of an artifact whose structure is not."""
    from .case import CASES

    data = CASES["groups_v1.group_is_its_own_child"].build(good)
    content, one = "0" * 64, f"{NAME}/pretrain-v1"
    return tar([(MANIFEST, told([entry(one, data, content)])), (f"{one}.h5", data)])


@case("either", form="export")  # taken under the next free number
def version_without_room_after_it(good: Good) -> bytes:
    copy = good.forged()
    copy.header["id"] = one = f"{NAME}/pretrain-v999999999"
    data = copy.file()
    return tar([(MANIFEST, told([entry(one, data, copy.header["content_sha256"])])), (f"{one}.h5", data)])
