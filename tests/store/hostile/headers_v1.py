# ruff: noqa: E501 - tables of one case a line
"""Object headers of HDF5's first format, which have no checksums: messages and continuations."""

from __future__ import annotations

import struct

from .case import Right, add
from .groups_v1 import Damage, damaged
from .layout import NONE, Bytes

PATH = "trajectories/action"
GOES_ON = 0x10
NOTE = 0x0C  # an attribute


def start(file: Bytes) -> int:
    """Address of the header of a dataset."""
    return file.header(PATH)


def message(kind: int, path: str = PATH) -> Damage:
    """Finds a message of a header: the address of its own head of eight bytes."""

    def find(file: Bytes) -> int:
        address = file.header(path)
        blocks = [(address + 16, file.peek(address + 8, "I"))]
        for place, size in blocks:
            end = place + size
            while place < end:
                if file.peek(place, "H") == kind:
                    return place
                if file.peek(place, "H") == GOES_ON:
                    blocks.append((file.peek(place + 8, "Q"), file.peek(place + 16, "Q")))
                place += 8 + file.peek(place + 2, "H")
        raise LookupError(kind)

    return find


def put(kind: int, offset: int, form: str, *values: int) -> Damage:
    return lambda file: file.poke(message(kind)(file) + offset, form, *values)


def become(kind: int, form: str, *values: int) -> Damage:
    """An attribute becomes another message, of the length that it had."""

    def damage(file: Bytes) -> None:
        place = message(NOTE)(file)
        file.poke(place, "H", kind).poke(place + 8, form, *values)

    return damage


def moved(blocks: list[bytes]) -> Damage:
    """The header goes on in these blocks, one after the other; `{}` in the last one is the first again."""

    def damage(file: Bytes) -> None:
        addresses: list[int] = []
        following, size = NONE, 0
        for block in reversed(blocks):
            piece = block + struct.pack("<HHB3xQQ", 0x10, 16, 0, following, size)
            addresses.append(file.append(piece))
            following, size = addresses[-1], len(piece)
        last = file.at(addresses[0]) + len(blocks[-1])
        struct.pack_into("<QQ", file.data, last + 8, addresses[-1], len(blocks[0]) + 24)  # the last goes on in the first
        become(GOES_ON, "QQ", following, size)(file)

    return damage


def own_continuation(file: Bytes) -> None:
    become(GOES_ON, "QQ", start(file) + 16, file.peek(start(file) + 8, "I"))(file)


def nil(size: int) -> bytes:
    return struct.pack("<HHB3x", 0, size, 0) + bytes(size)


HEADERS: dict[str, tuple[Right, Damage]] = {
    "65535_messages": ("either", lambda f: f.poke(start(f) + 2, "H", 65535)),
    "no_messages": ("refused", lambda f: f.poke(start(f) + 2, "H", 0)),
    "size_of_4_gib": ("refused", lambda f: f.poke(start(f) + 8, "I", 2**32 - 1)),
    "size_of_0": ("refused", lambda f: f.poke(start(f) + 8, "I", 0)),
    "references_of_0": ("either", lambda f: f.poke(start(f) + 4, "I", 0)),
    "references_of_4_billion": ("either", lambda f: f.poke(start(f) + 4, "I", 2**32 - 1)),
    "version_77": ("refused", lambda f: f.poke(start(f), "B", 77)),
    "continues_in_itself": ("refused", own_continuation),
    "continues_in_a_circle_of_two": ("refused", moved([nil(8), nil(8)])),
    "continues_in_a_circle_of_5000": ("refused", moved([nil(8)] * 5000)),
    "continues_beyond_the_end": ("refused", become(0x10, "QQ", 1 << 50, 64)),
    "continues_for_a_gib": ("refused", become(0x10, "QQ", 4096, 1 << 30)),
    "continues_for_nothing": ("refused", become(0x10, "QQ", 4096, 0)),
    "continues_nowhere": ("refused", become(0x10, "QQ", NONE, 64)),
    "message_longer_than_the_header": ("refused", put(0x03, 2, "H", 65528)),
    "message_of_an_odd_length": ("refused", put(0x03, 2, "H", 3)),
    "message_unknown": ("either", put(NOTE, 0, "H", 0x7777)),
    "message_unknown_must_be_known": ("refused", lambda f: f.poke(message(NOTE)(f), "H2xB", 0x77, 0x88)),
    "message_that_is_shared": ("refused", put(0x03, 4, "B", 2)),
    "space_of_rank_255": ("refused", put(0x01, 9, "B", 255)),
    "space_of_rank_33": ("refused", put(0x01, 9, "B", 33)),
    "space_of_rank_0": ("refused", put(0x01, 9, "B", 0)),
    "space_of_version_77": ("refused", put(0x01, 8, "B", 77)),
    "space_larger_than_its_largest": ("refused", put(0x01, 16, "Q", 37)),
    "space_of_2_to_the_63": ("refused", put(0x01, 16, "QQQ", 2**63, 2**63, 2)),
    "space_that_overflows": ("refused", put(0x01, 16, "QQQ", 2**32, 2**32, 2)),
    "space_of_zeros": ("refused", put(0x01, 16, "QQQ", 0, 50, 2)),
    "space_without_end": ("refused", put(0x01, 40, "QQQ", NONE, NONE, NONE)),
    "type_of_size_0": ("refused", put(0x03, 12, "I", 0)),
    "type_of_4_gib": ("refused", put(0x03, 12, "I", 2**32 - 1)),
    "type_of_3_bytes": ("refused", put(0x03, 12, "I", 3)),
    "type_of_class_15": ("refused", put(0x03, 8, "B", 0x1F)),
    "type_of_version_15": ("refused", put(0x03, 8, "B", 0xF1)),
    "type_of_variable_length": ("refused", put(0x03, 8, "B", 0x19)),
    "type_is_a_compound": ("refused", put(0x03, 8, "BBH", 0x16, 255, 255)),
    "type_is_an_array": ("refused", put(0x03, 8, "B", 0x3A)),
    "type_is_a_reference": ("refused", put(0x03, 8, "B", 0x17)),
    "type_with_bits_beyond": ("either", put(0x03, 16, "HH", 65535, 65535)),
    "type_big_endian": ("refused", put(0x03, 9, "B", 0x21)),
    "type_vax": ("refused", put(0x03, 9, "B", 0x61)),
    "fill_of_4_gib": ("refused", put(0x05, 8, "BBBBI", 2, 2, 2, 1, 2**31)),
    "fill_of_version_77": ("refused", put(0x05, 8, "B", 77)),
    "layout_of_version_77": ("refused", put(0x08, 8, "B", 77)),
    "layout_of_class_9": ("refused", put(0x08, 9, "B", 9)),
    "layout_of_rank_255": ("refused", put(0x08, 10, "B", 255)),
    "layout_of_rank_1": ("refused", put(0x08, 10, "B", 1)),
    "layout_index_is_its_header": ("refused", lambda f: f.poke(message(0x08)(f) + 11, "Q", start(f))),
    "layout_index_of_nothing": ("refused", put(0x08, 11, "Q", NONE)),
    "layout_index_of_another": ("refused", lambda f: f.poke(message(0x08)(f) + 11, "Q", f.peek(message(0x08, "trajectories/latent")(f) + 11, "Q"))),
    "layout_chunks_of_0": ("refused", put(0x08, 19, "III", 0, 0, 0)),
    "layout_chunks_of_4_billion": ("refused", put(0x08, 19, "III", 2**32 - 1, 2**32 - 1, 2**32 - 1)),
    "layout_element_of_0": ("refused", put(0x08, 31, "I", 0)),
    "layout_element_of_another_size": ("refused", put(0x08, 31, "I", 1)),
    "filters_255": ("refused", put(0x0B, 9, "B", 255)),
    "filters_none": ("either", put(0x0B, 9, "B", 0)),
    "filters_of_version_77": ("refused", put(0x0B, 8, "B", 77)),
    "filter_name_of_65528": ("refused", put(0x0B, 18, "H", 65528)),
    "filter_values_65535": ("refused", put(0x0B, 22, "H", 65535)),
    "filter_deflate_without_a_level": ("refused", put(0x0B, 16, "H", 1)),
    "filter_szip": ("refused", put(0x0B, 16, "H", 4)),
    "filter_nbit": ("refused", put(0x0B, 16, "H", 5)),
    "filter_scaleoffset": ("refused", put(0x0B, 16, "H", 6)),
    "filter_of_a_plugin": ("refused", put(0x0B, 16, "H", 32001)),
    "filter_that_may_lack": ("refused", put(0x0B, 16, "HHH", 32001, 0, 1)),
    "attribute_name_of_65535": ("refused", put(NOTE, 10, "H", 65535)),
    "attribute_name_of_0": ("refused", put(NOTE, 10, "H", 0)),
    "attribute_type_of_65535": ("refused", put(NOTE, 12, "H", 65535)),
    "attribute_space_of_65535": ("refused", put(NOTE, 14, "H", 65535)),
    "attribute_of_version_77": ("refused", put(NOTE, 8, "B", 77)),
    "attribute_name_without_end": ("refused", put(NOTE, 16, "12s", b"dimensionsxx")),
    "attributes_of_one_name": ("refused", lambda f: f.data.__setitem__(slice(None), f.data.replace(b"unit\0", b"dime\0"))),
    "external_files": ("refused", put(NOTE, 0, "H", 0x07)),
    "a_link_in_a_dataset": ("refused", put(NOTE, 0, "H", 0x06)),
    "a_symbol_table_in_a_dataset": ("refused", become(0x11, "QQ", 136, 680)),
    "a_second_space": ("refused", put(NOTE, 0, "H", 0x01)),
    "a_second_type": ("refused", put(NOTE, 0, "H", 0x03)),
    "a_second_layout": ("refused", put(NOTE, 0, "H", 0x08)),
    "times_at_both_ends": ("either", become(0x12, "II", 1, 2**32 - 1)),
}  # fmt: skip
for name, (right, damage) in HEADERS.items():
    add(f"headers_v1.{name}", damaged(damage), right)
