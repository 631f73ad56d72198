# ruff: noqa: E501 - tables of one case a line
"""Datasets of HDF5's present format whose headers say anything: types, extents, layouts, indexes, filters, attributes."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from .case import Right, add
from .groups_v2 import Damage, damaged, summed
from .layout import NONE, Bytes

PATH = "weights/policy.log_std"  # two single precision numbers in one chunk with a sum
SPACE, TYPE, FILL, LAYOUT, FILTERS, NOTE, GOES_ON, LINK, ABOUT = 1, 3, 5, 8, 0x0B, 0x0C, 0x10, 6, 0x15
FLOAT = bytes.fromhex("11201f000400000000002000170800177f000000")
INTEGER = bytes.fromhex("100800000800000000004000")
FLETCHER = struct.pack("<BBHHH", 2, 1, 3, 0, 0)
Message = tuple[int, bytes, int]  # kind, content, flags


def extent(*sizes: int, rank: int | None = None, kind: int = 1, largest: Sequence[int] = ()) -> bytes:
    head = struct.pack("<BBBB", 2, len(sizes) if rank is None else rank, bool(largest), kind)
    return head + b"".join(struct.pack("<Q", size) for size in (*sizes, *largest))


def single(address: int, size: int = 12, chunk: Sequence[int] = (2, 4), index: int = 1, mask: int = 0, width: int = 1) -> bytes:
    """Layout of one chunk with filters."""
    sizes = b"".join(one.to_bytes(width, "little") for one in chunk)
    return struct.pack("<BBBBB", 4, 2, 2, len(chunk), width) + sizes + struct.pack("<BQIQ", index, size, mask, address)


def indexed(kind: int, body: bytes, chunk: Sequence[int] = (1, 4)) -> bytes:
    return struct.pack("<BBBBB", 4, 2, 0, len(chunk), 1) + bytes(chunk) + bytes([kind]) + body


def note(
    name: bytes = b"unit\0", kind: bytes = INTEGER, space: bytes = extent(kind=0), data: bytes = bytes(8), **lengths: int
) -> bytes:
    sizes = [lengths.get(part, len(text)) for part, text in (("name", name), ("kind", kind), ("space", space))]
    return struct.pack("<BBHHHB", lengths.get("version", 3), lengths.get("flags", 0), *sizes, 1) + name + kind + space + data


def header(messages: Sequence[Message], flags: int = 2, size: int | None = None, version: int = 2) -> bytes:
    text = b"".join(struct.pack("<BHB", kind, len(body), flag) + body for kind, body, flag in messages)
    return summed(b"OHDR" + struct.pack("<BBI", version, flags, len(text) if size is None else size) + text)


def chunk(file: Bytes) -> int:
    """Where the numbers of the dataset lie."""
    layout = file.good.index(b"\x04\x02\x02\x02\x01\x02\x04\x01", file.at(file.header(PATH)))
    return int(struct.unpack_from("<Q", file.good, layout + 20)[0])


def messages(file: Bytes, **parts: bytes | None) -> list[Message]:
    """Those of an honest dataset, but for some; None for none."""
    texts = [note(name, b"\x13\x11\0\0" + struct.pack("<I", len(text)), extent(kind=0), text) for name, text in
             ((b"dimensions\0", b"axis0"), (b"unit\0", b"\0"))]  # fmt: skip
    about = b"\0\0" + struct.pack("<QQ", NONE, NONE)  # without it HDF5 counts no attributes, and still reads them
    honest = {"space": extent(2), "type": FLOAT, "fill": b"\x03\x0b", "filters": FLETCHER, "about": about}
    if "layout" not in parts:
        honest["layout"] = single(chunk(file))
    kinds = {"space": SPACE, "type": TYPE, "fill": FILL, "layout": LAYOUT, "filters": FILTERS, "about": ABOUT}
    told = [(kinds[name], body, 0) for name, body in (honest | parts).items() if body is not None]
    return told + [(NOTE, text, 0) for text in texts]


def told(more: Sequence[Message] = (), how: dict[str, int] | None = None, **parts: bytes | None) -> Damage:
    """The dataset's header is written anew."""
    return lambda file: file.redirect(PATH, file.append(header([*messages(file, **parts), *more], **(how or {}))))


def honest(file: Bytes) -> None:
    told()(file)


def compound(depth: int) -> bytes:
    return (b"\x36\x01\0\0" + struct.pack("<I", 4) + b"a\0\0") * depth + FLOAT


def array(depth: int) -> bytes:
    return (b"\x3a\0\0\0" + struct.pack("<IBI", 4, 1, 1)) * depth + FLOAT


def variable(depth: int) -> bytes:
    return (b"\x39\0\0\0" + struct.pack("<I", 16)) * depth + FLOAT


def opaque(size: int) -> bytes:
    return b"\x15\0\0\0" + struct.pack("<I", size)


def shared_with_itself(file: Bytes) -> None:
    """A type that lies where it is used, and says that it lies there."""
    place = len(file.data) + -len(file.data) % 8 - file.base
    own = [
        (kind, b"\x03\x02" + struct.pack("<Q", place), 2) if kind == TYPE else (kind, body, flag)
        for kind, body, flag in messages(file)
    ]
    assert file.append(header(own)) == place
    file.redirect(PATH, place)


def shared_with_each_other(file: Bytes) -> None:
    first = len(file.data) + -len(file.data) % 8 - file.base
    second = first + len(header([(TYPE, bytes(10), 2)])) + 7 & ~7
    file.append(header([(TYPE, b"\x03\x02" + struct.pack("<Q", second), 2)]))
    assert file.append(header([(TYPE, b"\x03\x02" + struct.pack("<Q", first), 2)])) == second
    told(type=None, more=[(TYPE, b"\x03\x02" + struct.pack("<Q", first), 2)])(file)


def space_is_shared(file: Bytes) -> None:
    told(space=None, more=[(SPACE, b"\x03\x02" + struct.pack("<Q", file.header("weights")), 2)])(file)


def goes_on(size: int, *, kinds: int = 1, circle: bool = True) -> Damage:
    """The header goes on in blocks that go on in each other."""

    def damage(file: Bytes) -> None:
        start = len(file.data) + -len(file.data) % 8 - file.base
        length = (4 + size + 20 + 4 + 7) & ~7
        addresses = [start + i * length for i in range(kinds)]
        for number in range(kinds):
            following = addresses[(number + 1) % kinds] if circle or number + 1 < kinds else NONE
            pad = length - 4 - 4 - 4 - 20
            body = struct.pack("<BHB", 0, pad, 0) + bytes(pad) + struct.pack("<BHBQQ", GOES_ON, 16, 0, following, length)
            block = summed(b"OCHK" + body)
            file.append(block + bytes(length - len(block)))
        told([(GOES_ON, struct.pack("<QQ", addresses[0], length), 0)])(file)

    return damage


def fixed_array(count: int, blocks: str = "own", page: int = 10, entry: int = 8, client: int = 0) -> Damage:
    """Chunks found in a fixed array that says it has so many places."""

    def damage(file: Bytes) -> None:
        place = len(file.data) + -len(file.data) % 8 - file.base
        data = {"own": place, "nowhere": NONE, "beyond": 1 << 50, "there": place + 32}[blocks]
        file.append(summed(b"FAHD" + struct.pack("<BBBBQQ", 0, client, entry, page, count, data)).ljust(32, b"\0"))
        file.append(
            summed(b"FADB" + struct.pack("<BBQ", 0, client, place) + struct.pack("<Q", chunk(file)) * min(count, 10_000))
        )
        told(layout=indexed(3, struct.pack("<BQ", page, place)), filters=None, space=extent(count))(file)

    return damage


def extensible_array(**parts: int) -> Damage:
    def damage(file: Bytes) -> None:
        place = len(file.data) + -len(file.data) % 8 - file.base
        head = {"entry": 8, "bits": 32, "index": 4, "least": 16, "pointers": 4, "page": 10} | parts
        sizes = [head[name] for name in ("entry", "bits", "index", "least", "pointers", "page")]
        file.append(summed(b"EAHD" + bytes([0, 0, *sizes]) + struct.pack("<6QQ", 0, 0, 0, 0, 4, 2, place)))
        body = bytes([head["bits"], head["index"], head["pointers"], head["least"], head["page"]]) + struct.pack("<Q", place)
        told(layout=indexed(4, body), filters=None, space=extent(2, largest=(NONE,)))(file)

    return damage


def tree_of_chunks(depth: int, node: int = 512, kind: int = 10) -> Damage:
    def damage(file: Bytes) -> None:
        place = len(file.data) + -len(file.data) % 8 - file.base
        head = b"BTHD" + struct.pack("<BBIHHBBQHQ", 0, kind, node, 24, depth, 100, 40, place, 3, 3)
        file.append(summed(head))
        body = struct.pack("<IBBQ", node, 100, 40, place)
        told(layout=indexed(5, body, (1, 1, 4)), filters=None, space=extent(2, 2, largest=(NONE, NONE)))(file)

    return damage


def many_filters(count: int, code: int) -> bytes:
    return struct.pack("<BB", 2, count) + struct.pack("<HHHI", code, 0, 1, 9) * count


def overlapping(file: Bytes) -> None:
    """Two arrays in one piece of the file."""
    other = file.good.index(b"\x04\x02\x02", file.at(file.header("weights/embedding.raw_std")))
    place = file.good.index(b"\x04\x02\x02", file.at(file.header("weights/embedding.raw_mean"))) - file.base
    file.poke(place + 20, "Q", struct.unpack_from("<Q", file.good, other + 20)[0])


def external(file: Bytes) -> None:
    told(
        [(0x07, struct.pack("<B3xHHQ", 1, 1, 1, 0) + struct.pack("<QQQ", 0, 0, 8), 0)],
        layout=struct.pack("<BBQQ", 4, 1, NONE, 8),
        filters=None,
    )(file)


def contiguous(address: int, size: int = 8, version: int = 4) -> bytes:
    return struct.pack("<BBQQ", version, 1, address, size)


CASES: dict[str, tuple[Right, Damage]] = {
    "type_compound_5900_deep": ("refused", told(type=compound(5900))),
    "type_compound_500_deep": ("refused", told(type=compound(500))),
    "type_array_5000_deep": ("refused", told(type=array(5000))),
    "type_variable_8000_deep": ("refused", told(type=variable(8000))),
    "type_of_65535_members": ("refused", told(type=b"\x36\xff\xff\0" + struct.pack("<I", 4) + b"a\0\0" + FLOAT)),
    "type_of_members_of_one_name": ("refused", told(type=b"\x36\x02\0\0" + struct.pack("<I", 8) + (b"a\0\0" + FLOAT) * 2)),
    "type_array_of_rank_255": ("refused", told(type=b"\x3a\0\0\0" + struct.pack("<IB", 4, 255) + struct.pack("<I", 1) * 255 + FLOAT)),
    "type_array_that_overflows": ("refused", told(type=b"\x3a\0\0\0" + struct.pack("<IBII", 4, 2, 2**31, 2**31) + FLOAT)),
    "type_array_of_nothing": ("refused", told(type=b"\x3a\0\0\0" + struct.pack("<IBI", 4, 1, 0) + FLOAT)),
    "type_opaque_of_4_gib": ("refused", told(type=opaque(2**32 - 1))),
    "type_float_of_4_gib": ("refused", told(type=FLOAT[:4] + struct.pack("<I", 2**32 - 1) + FLOAT[8:])),
    "type_float_of_0_bytes": ("refused", told(type=FLOAT[:4] + bytes(4) + FLOAT[8:])),
    "type_float_of_2_bits": ("either", told(type=FLOAT[:10] + b"\x02\0" + FLOAT[12:])),
    "type_float_exponent_beyond": ("refused", told(type=FLOAT[:12] + b"\xff\xff\xff\xff" + FLOAT[16:])),
    "type_float_bias_of_0": ("refused", told(type=FLOAT[:16] + bytes(4))),
    "type_float_sign_elsewhere": ("refused", told(type=FLOAT[:2] + b"\x00" + FLOAT[3:])),
    "type_integer_of_3_bytes": ("refused", told(type=b"\x10\x08\0\0\x03\0\0\0\0\0\x18\0", layout=None)),
    "type_integer_of_7_bits": ("refused", told(type=b"\x10\x08\0\0\x04\0\0\0\x03\0\x07\0")),
    "type_integer_with_padding_of_ones": ("refused", told(type=b"\x10\x0e\0\0\x04\0\0\0\0\0\x20\0")),
    "type_enum_of_floats": ("refused", told(type=b"\x38\x01\0\0" + struct.pack("<I", 4) + FLOAT + b"a\0" + bytes(4))),
    "type_enum_of_65535": ("refused", told(type=b"\x38\xff\xff\0" + struct.pack("<I", 8) + INTEGER)),
    "type_enum_false_twice": ("refused", told(type=b"\x38\x02\0\0\x01\0\0\0" + b"\x10\x08\0\0\x01\0\0\0\0\0\x08\0" + b"FALSE\0TRUE\0\0\0")),
    "type_of_time": ("refused", told(type=b"\x12\0\0\0\x04\0\0\0\x20\0")),
    "type_of_bits": ("refused", told(type=b"\x14\0\0\0\x04\0\0\0\0\0\x20\0")),
    "type_of_class_12": ("refused", told(type=b"\x5c\0\0\0\x08\0\0\0" + FLOAT)),
    "type_complex": ("refused", told(type=b"\x5b\x01\0\0\x08\0\0\0" + FLOAT)),
    "type_reference_of_version_4": ("refused", told(type=b"\x47\x02\x01\0\x10\0\0\0")),
    "type_cut_short": ("refused", told(type=FLOAT[:9])),
    "type_of_nothing": ("refused", told(type=b"")),
    "type_missing": ("refused", told(type=None)),
    "type_shared_with_itself": ("refused", shared_with_itself),
    "types_shared_with_each_other": ("refused", shared_with_each_other),
    "type_shared_in_the_heap": ("refused", told(type=None, more=[(TYPE, b"\x03\x01" + bytes(8), 2)])),
    "space_is_shared_with_a_group": ("refused", space_is_shared),
    "space_of_rank_33": ("refused", told(space=extent(*[1] * 33))),
    "space_of_rank_255": ("refused", told(space=extent(*[1] * 255))),
    "space_of_rank_32_in_a_chunk": ("refused", told(space=extent(*[1] * 32), layout=None)),
    "space_rank_beyond_its_sizes": ("refused", told(space=extent(2, rank=7))),
    "space_that_is_scalar_of_rank_1": ("refused", told(space=extent(2, kind=0))),
    "space_that_is_null_of_rank_1": ("refused", told(space=extent(2, kind=2))),
    "space_that_is_null": ("refused", told(space=extent(kind=2))),
    "space_of_kind_77": ("refused", told(space=extent(2, kind=77))),
    "space_of_2_to_the_63": ("refused", told(space=extent(2**63))),
    "space_that_overflows_to_2": ("refused", told(space=extent(2**32, 2**32, 2), layout=None)),
    "space_may_grow": ("refused", told(space=extent(2, largest=(NONE,)))),
    "space_larger_than_its_largest": ("refused", told(space=extent(2, largest=(1,)))),
    "space_missing": ("refused", told(space=None)),
    "space_twice": ("either", told([(SPACE, extent(3), 0)])),
    "type_twice": ("either", told([(TYPE, INTEGER, 0)])),
    "layout_twice": ("either", told([(LAYOUT, contiguous(0), 0)])),
    "layout_missing": ("refused", told(layout=None)),
    "layout_chunk_of_4_gib": ("refused", lambda f: told(layout=single(chunk(f), chunk=(2**30, 4), width=4))(f)),
    "layout_chunk_of_0": ("refused", lambda f: told(layout=single(chunk(f), chunk=(0, 4)))(f)),
    "layout_chunk_of_255_numbers": ("refused", lambda f: told(layout=single(chunk(f), chunk=(255, 4)))(f)),
    "layout_chunk_element_of_0": ("refused", lambda f: told(layout=single(chunk(f), chunk=(2, 0)))(f)),
    "layout_chunk_element_of_8": ("refused", lambda f: told(layout=single(chunk(f), chunk=(2, 8)))(f)),
    "layout_chunk_of_rank_0": ("refused", lambda f: told(layout=single(chunk(f), chunk=(4,)))(f)),
    "layout_chunk_of_rank_33": ("refused", lambda f: told(layout=single(chunk(f), chunk=[1] * 34))(f)),
    "layout_chunk_sizes_of_8_bytes": ("refused", lambda f: told(layout=single(chunk(f), chunk=(2**60, 4), width=8))(f)),
    "layout_chunk_sizes_of_255_bytes": ("refused", lambda f: told(layout=single(chunk(f)).replace(b"\x02\x01\x02\x04", b"\x02\xff\x02\x04"))(f)),
    "layout_chunk_stored_as_2_to_the_60": ("refused", lambda f: told(layout=single(chunk(f), 1 << 60))(f)),
    "layout_chunk_stored_as_4_gib": ("either", lambda f: told(layout=single(chunk(f), (1 << 32) + 12))(f)),
    "layout_chunk_stored_as_1_gib": ("refused", lambda f: told(layout=single(chunk(f), 1 << 30))(f)),
    "layout_chunk_stored_as_0": ("refused", lambda f: told(layout=single(chunk(f), 0))(f)),
    "layout_chunk_stored_as_3": ("refused", lambda f: told(layout=single(chunk(f), 3))(f)),
    "layout_chunk_with_a_mask": ("refused", lambda f: told(layout=single(chunk(f), 8, mask=1))(f)),
    "layout_chunk_at_the_superblock": ("refused", told(layout=single(0))),
    "layout_chunk_beyond": ("refused", told(layout=single(1 << 50))),
    "layout_chunk_nowhere": ("refused", told(layout=single(NONE))),
    "layout_chunk_before_the_file": ("refused", told(layout=single(2**64 - 4096))),
    "layout_index_0": ("refused", lambda f: told(layout=single(chunk(f), index=0))(f)),
    "layout_index_9": ("refused", lambda f: told(layout=single(chunk(f), index=9))(f)),
    "layout_implicit": ("either", lambda f: told(layout=indexed(2, struct.pack("<Q", chunk(f))), filters=None)(f)),
    "layout_implicit_of_a_million": ("refused", lambda f: told(layout=indexed(2, struct.pack("<Q", 0)), filters=None, space=extent(10**6))(f)),
    "layout_implicit_with_filters": ("refused", lambda f: told(layout=indexed(2, struct.pack("<Q", chunk(f))))(f)),
    "layout_contiguous": ("either", lambda f: told(layout=contiguous(chunk(f)), filters=None)(f)),
    "layout_contiguous_with_filters": ("either", lambda f: told(layout=contiguous(chunk(f)))(f)),
    "layout_contiguous_beyond": ("refused", told(layout=contiguous(1 << 50), filters=None)),
    "layout_contiguous_of_2_to_the_60": ("refused", lambda f: told(layout=contiguous(chunk(f), 1 << 60), filters=None)(f)),
    "layout_contiguous_of_4_bytes": ("refused", lambda f: told(layout=contiguous(chunk(f), 4), filters=None)(f)),
    "layout_contiguous_in_the_superblock": ("either", told(layout=contiguous(0), filters=None)),
    "layout_compact": ("refused", told(layout=struct.pack("<BBH", 4, 0, 8) + bytes(8), filters=None)),
    "layout_compact_of_65535": ("refused", told(layout=struct.pack("<BBH", 4, 0, 65535) + bytes(8), filters=None)),
    "layout_compact_of_0": ("refused", told(layout=struct.pack("<BBH", 4, 0, 0), filters=None)),
    "layout_virtual": ("refused", told(layout=struct.pack("<BBQI", 4, 3, NONE, 0), filters=None)),
    "layout_virtual_in_a_heap": ("refused", told(layout=struct.pack("<BBQI", 4, 3, 4096, 1), filters=None)),
    "layout_of_version_1": ("refused", told(layout=struct.pack("<BBB5xQII", 1, 1, 1, 0, 2, 4), filters=None)),
    "layout_of_version_5": ("either", lambda f: told(layout=b"\x05" + single(chunk(f))[1:])(f)),
    "layout_of_version_77": ("refused", told(layout=b"\x4d" + bytes(30))),
    "layout_of_class_9": ("refused", told(layout=b"\x04\x09" + bytes(30))),
    "layout_cut_short": ("refused", lambda f: told(layout=single(chunk(f))[:9])(f)),
    "fixed_array_in_itself": ("refused", fixed_array(2)),
    "fixed_array_nowhere": ("refused", fixed_array(2, "nowhere")),
    "fixed_array_beyond": ("refused", fixed_array(2, "beyond")),
    "fixed_array_all_one_chunk": ("refused", fixed_array(900, "there")),
    "fixed_array_of_2_to_the_40": ("refused", fixed_array(2**40)),
    "fixed_array_of_3000_000": ("refused", fixed_array(3_000_000, "there")),
    "fixed_array_pages_of_0_bits": ("refused", fixed_array(2, "there", page=0)),
    "fixed_array_pages_of_63_bits": ("refused", fixed_array(2, "there", page=63)),
    "fixed_array_entries_of_0": ("refused", fixed_array(2, "there", entry=0)),
    "fixed_array_entries_of_255": ("refused", fixed_array(2, "there", entry=255)),
    "fixed_array_of_another_client": ("refused", fixed_array(2, "there", client=1)),
    "fixed_array_of_unknown_clients": ("refused", fixed_array(2, "there", client=200)),
    "extensible_array_in_itself": ("refused", extensible_array()),
    "extensible_array_of_0_bits": ("refused", extensible_array(bits=0)),
    "extensible_array_of_255_bits": ("refused", extensible_array(bits=255)),
    "extensible_array_of_least_0": ("refused", extensible_array(least=0)),
    "extensible_array_of_least_255": ("refused", extensible_array(least=255)),
    "extensible_array_pages_of_0": ("refused", extensible_array(page=0)),
    "extensible_array_pages_of_64": ("refused", extensible_array(page=64)),
    "extensible_array_without_pointers": ("refused", extensible_array(pointers=0)),
    "tree_of_chunks_in_itself": ("refused", tree_of_chunks(1)),
    "tree_of_chunks_of_65535_levels": ("refused", tree_of_chunks(65535)),
    "tree_of_chunks_of_no_levels": ("refused", tree_of_chunks(0)),
    "tree_of_chunks_of_0_bytes": ("refused", tree_of_chunks(1, 0)),
    "tree_of_chunks_of_4_gib": ("refused", tree_of_chunks(1, 2**32 - 1)),
    "tree_of_chunks_of_links": ("refused", tree_of_chunks(1, 512, 5)),
    "filters_255": ("refused", told(filters=struct.pack("<BB", 2, 255))),
    "filters_32_of_one_kind": ("refused", told(filters=many_filters(32, 1))),
    "filters_33_of_one_kind": ("refused", told(filters=many_filters(33, 1))),
    "filters_of_none": ("either", told(filters=struct.pack("<BB", 2, 0))),
    "filter_values_65535": ("refused", told(filters=struct.pack("<BBHHH", 2, 1, 3, 0, 65535))),
    "filter_deflate_level_4_billion": ("refused", told(filters=struct.pack("<BBHHHI", 2, 1, 1, 0, 1, 2**32 - 1))),
    "filter_deflate_without_a_level": ("refused", told(filters=struct.pack("<BBHHH", 2, 1, 1, 0, 0))),
    "filter_shuffle_of_4_billion": ("either", told(filters=struct.pack("<BBHHHI", 2, 1, 2, 0, 1, 2**32 - 1))),
    "filter_shuffle_of_0": ("refused", told(filters=struct.pack("<BBHHHI", 2, 1, 2, 0, 1, 0))),
    "filter_fletcher_optional": ("either", told(filters=struct.pack("<BBHHH", 2, 1, 3, 1, 0))),
    "filter_fletcher_with_values": ("either", told(filters=struct.pack("<BBHHHI", 2, 1, 3, 0, 1, 7))),
    "filter_szip": ("refused", told(filters=struct.pack("<BBHHH4I", 2, 1, 4, 0, 4, 141, 32, 4, 2))),
    "filter_nbit": ("refused", told(filters=struct.pack("<BBHHH8I", 2, 1, 5, 0, 8, 8, 0, 2, 1, 4, 0, 32, 0))),
    "filter_scaleoffset": ("refused", told(filters=struct.pack("<BBHHH20I", 2, 1, 6, 0, 20, *[1] * 20))),
    "filter_of_a_plugin": ("refused", told(filters=struct.pack("<BBHHHH", 2, 1, 32001, 0, 0, 0))),
    "filter_of_a_plugin_with_a_name": ("refused", told(filters=struct.pack("<BBHHHH", 2, 1, 32001, 65535, 0, 0) + b"../../x\0")),
    "filter_of_a_plugin_that_may_lack": ("refused", told(filters=struct.pack("<BBHHHH", 2, 1, 32001, 0, 1, 0))),
    "filters_of_version_1": ("either", told(filters=struct.pack("<BB6xHHHH", 1, 1, 3, 0, 0, 0))),
    "fill_of_2_gib": ("refused", told(fill=b"\x03\x2b" + struct.pack("<I", 2**31))),
    "fill_of_its_type": ("either", told(fill=b"\x03\x2b" + struct.pack("<If", 4, 1.0))),
    "fill_of_three_bytes": ("either", told(fill=b"\x03\x2b" + struct.pack("<I", 3) + b"abc")),
    "fill_cut_short": ("refused", told(fill=b"\x03")),
    "fill_missing": ("either", told(fill=None)),
    "note_name_of_65535": ("refused", told([(NOTE, struct.pack("<BBHHHB", 3, 0, 65535, 12, 4, 1), 0)])),
    "note_name_of_0": ("refused", told([(NOTE, struct.pack("<BBHHHB", 3, 0, 0, 12, 4, 1) + INTEGER + extent(kind=0) + bytes(8), 0)])),
    "note_name_without_end": ("refused", told([(NOTE, note(b"abcd"), 0)])),
    "note_name_with_a_zero": ("refused", told([(NOTE, note(b"a\0b\0"), 0)])),
    "note_of_one_name": ("refused", told([(NOTE, note(), 0)])),
    "note_type_5000_deep": ("refused", told([(NOTE, note(b"x\0", variable(7000), data=bytes(16)), 0)])),
    "note_type_compound_5000_deep": ("refused", told([(NOTE, note(b"x\0", compound(5500), data=bytes(16)), 0)])),
    "note_without_data": ("refused", told([(NOTE, note(b"x\0", data=b""), 0)])),
    "note_of_2_to_the_60": ("refused", told([(NOTE, note(b"x\0", space=extent(1 << 60)), 0)])),
    "note_of_rank_255": ("refused", told([(NOTE, note(b"x\0", space=extent(*[1] * 255)), 0)])),
    "note_that_is_null": ("refused", told([(NOTE, note(b"x\0", space=extent(kind=2), data=b""), 0)])),
    "note_that_is_shared": ("refused", told([(NOTE, b"\x03\x02" + bytes(8), 2)])),
    "note_type_shared": ("refused", told([(NOTE, struct.pack("<BBHHHB", 3, 1, 2, 10, 4, 1) + b"x\0\x03\x02" + bytes(8) + extent(kind=0), 0)])),
    "note_of_version_77": ("refused", told([(NOTE, b"\x4d" + bytes(40), 0)])),
    "note_of_64_kB": ("refused", told([(NOTE, note(b"x\0", opaque(65_000), data=bytes(65_000)), 0)])),
    "17_notes_uncounted": ("refused", told([(NOTE, note(b"%d\0" % i), 0) for i in range(17)], about=None)),
    "notes_uncounted": ("either", told(about=None)),
    "17_notes": ("refused", told([(NOTE, note(b"%d\0" % i), 0) for i in range(17)])),
    "3000_notes": ("refused", told([(NOTE, note(b"%d\0" % i), 0) for i in range(3000)])),
    "a_million_messages_of_nothing": ("either", told([(0, b"", 0)] * 1_000_000)),
    "message_unknown": ("either", told([(0x77, bytes(8), 0)])),
    "message_unknown_must_be_known": ("refused", told([(0x77, bytes(8), 0x88)])),
    "message_of_a_link": ("either", told([(LINK, b"\x01\0\x01a" + bytes(8), 0)])),
    "message_of_a_symbol_table": ("refused", told([(0x11, bytes(16), 0)])),
    "message_of_a_link_table": ("refused", told([(2, b"\0\0" + struct.pack("<QQ", 4096, 4096), 0)])),
    "message_of_attributes_elsewhere": ("refused", told([(0x15, b"\0\x03\xff\xff" + struct.pack("<QQQ", 4096, 4096, 4096), 0)])),
    "message_of_external_files": ("refused", external),
    "message_of_references": ("either", told([(0x16, b"\0" + struct.pack("<I", 2**32 - 1), 0)])),
    "message_of_a_bogus_kind": ("either", told([(9, struct.pack("<I", 0xDEADBEEF), 0)])),
    "header_goes_on_in_itself": ("refused", goes_on(40)),
    "header_goes_on_in_a_circle_of_3000": ("refused", goes_on(40, kinds=3000)),
    "header_goes_on_20000_times": ("either", goes_on(40, kinds=20_000, circle=False)),
    "header_goes_on_beyond": ("refused", told([(GOES_ON, struct.pack("<QQ", 1 << 50, 64), 0)])),
    "header_goes_on_for_a_gib": ("refused", told([(GOES_ON, struct.pack("<QQ", 4096, 1 << 30), 0)])),
    "header_goes_on_for_3_bytes": ("refused", told([(GOES_ON, struct.pack("<QQ", 4096, 3), 0)])),
    "header_of_4_gib": ("refused", told(how={"size": 2**32 - 1})),
    "header_of_256_mib": ("refused", told(how={"size": 1 << 28})),
    "header_of_0_bytes": ("refused", told(how={"size": 0})),
    "header_of_version_77": ("refused", told(how={"version": 77})),
    "header_flags_255": ("refused", told(how={"flags": 255})),
    "arrays_in_one_place": ("refused", overlapping),
}  # fmt: skip
for name, (right, damage) in CASES.items():
    add(f"messages_v2.{name}", damaged(damage), right)
add("messages_v2.nothing_wrong", damaged(honest), "either")
