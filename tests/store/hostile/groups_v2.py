# ruff: noqa: E501 - tables of one case a line
"""Groups of HDF5's present format, which the store writes: B-trees of version 2, fractal heaps, links, superblock.

Every one of these structures has a checksum, and every checksum is right.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from .case import Right, add
from .good import Good
from .layout import NONE, Bytes, lookup3

Damage = Callable[[Bytes], object]
MANY = 120  # names more in a group, so that its B-tree has two levels


@lru_cache(maxsize=1)
def _new(good: bytes) -> bytes:
    from .forge import forge

    copy = forge(good)
    copy.header["id"] = "hostile/pretrain-v1"
    copy.arrays |= {f"weights/more{i:03}": np.ones(1, np.float32) for i in range(MANY)}
    return copy.file()


def damaged(damage: Damage) -> Callable[[Good], bytes]:
    def build(good: Good) -> bytes:
        file = Bytes(_new(good.data()))
        damage(file)
        return file.file()

    return build


def links(file: Bytes, path: str = "weights") -> tuple[int, int]:
    """Addresses of the heap that holds the links of a large group, and of the B-tree of their names."""
    place = file.good.index(b"\x02\x12\0\0\0\0", file.at(file.header(path)))
    heap, tree = struct.unpack_from("<QQ", file.good, place + 6)
    return heap, tree


def tree(file: Bytes) -> int:
    return links(file)[1]


def heap(file: Bytes) -> int:
    return links(file)[0]


def root(file: Bytes) -> int:
    """The topmost node, which has nodes of records below."""
    return file.peek(tree(file) + 16, "Q")


def records(file: Bytes) -> int:
    return file.peek(tree(file) + 24, "H")


def children(file: Bytes) -> int:
    """Where the pointers of the topmost node begin: address (8) and number of records (1) each."""
    return root(file) + 6 + 11 * records(file)


def leaf(file: Bytes) -> int:
    return file.peek(children(file), "Q")


def block(file: Bytes) -> int:
    """The first block of data of the heap."""
    return file.find(b"FHDB" + b"\0" + struct.pack("<Q", heap(file)))


def indirect(file: Bytes) -> int:
    return file.find(b"FHIB" + b"\0" + struct.pack("<Q", heap(file)))


def at(place: Callable[[Bytes], int], offset: int, form: str, *values: int) -> Damage:
    return lambda file: file.poke(place(file) + offset, form, *values)


def summed(block: bytes) -> bytes:
    return block + struct.pack("<I", lookup3(block))


def all_the_same(file: Bytes) -> None:
    first = file.data[file.at(children(file)) : file.at(children(file)) + 9]
    start, count = file.at(children(file)), records(file) + 1
    file.data[start : start + 9 * count] = first * count


def widths(levels: int) -> list[int]:
    """Bytes of a count of all records below, by depth, for records of 11 bytes in nodes of 512."""
    cumulated, found = 45, [0]
    for depth in range(1, levels + 1):
        pointer = 8 + 1 + found[-1] if depth > 1 else 9
        most = (512 - 10 - pointer) // (11 + pointer)
        cumulated = (most + 1) * cumulated + most
        found.append((cumulated.bit_length() + 7) // 8)
    return found


def inner(record: bytes, below: int, count: int, width: int, ways: int) -> bytes:
    """A node with the same child several times."""
    pointer = struct.pack("<QB", below, count) + (2**40).to_bytes(16, "little")[:width]
    return summed(b"BTIN\0\x05" + record * (ways - 1) + pointer * ways).ljust(512, b"\0")


def doubling(levels: int, ways: int) -> Damage:
    """Few nodes, and no end of ways through them."""

    def damage(file: Bytes) -> None:
        record = bytes(file.data[file.at(leaf(file)) + 6 :][:11])
        below, count, wide = leaf(file), file.peek(children(file) + 8, "B"), widths(levels)
        for depth in range(1, levels + 1):
            below = file.append(inner(record, below, count, wide[depth - 1] if depth > 1 else 0, ways))
            count = ways - 1
        file.poke(tree(file) + 12, "H", levels).poke(tree(file) + 16, "QH", below, count)

    return damage


def own_child(levels: int) -> Damage:
    """A node that is its own child on every level."""

    def damage(file: Bytes) -> None:
        record = bytes(file.data[file.at(leaf(file)) + 6 :][:11])
        place = file.append(bytes(512))
        node = inner(record, place, 1, widths(3)[2], 2)
        file.data[file.at(place) : file.at(place) + 512] = node
        file.poke(tree(file) + 12, "H", levels).poke(tree(file) + 16, "QH", place, 1)

    return damage


def same_record(file: Bytes) -> None:
    """A leaf that names one link as often as it has places."""
    start = file.at(leaf(file)) + 6
    count = file.peek(children(file) + 8, "B")
    file.data[start : start + 11 * count] = file.data[start : start + 11] * count


def another_tree(file: Bytes) -> None:
    """The names of a group are looked up in the tree of another."""
    place = file.good.index(b"\x02\x12\0\0\0\0", file.at(file.header("weights"))) - file.base
    file.poke(place + 14, "Q", links(file, "curves")[1])


def link_message(file: Bytes, name: str = "more000") -> int:
    """Address of the link to an array within the heap: version, flags, length of the name, name, address."""
    return int(file.good.index(bytes([1, 0, len(name)]) + name.encode(), file.base)) - file.base


def linked(path: str) -> Damage:
    """A link leads to another object."""
    return lambda file: file.poke(link_message(file) + 10, "Q", file.header(path))


def extension(body: bytes, kind: int) -> Damage:
    """The superblock goes on in a header with one message."""

    def damage(file: Bytes) -> None:
        messages = struct.pack("<BHB", kind, len(body), 0) + body
        file.poke(20, "Q", file.append(summed(b"OHDR\x02\x02" + struct.pack("<I", len(messages)) + messages)))

    return damage


DAMAGES: dict[str, tuple[Right, Damage]] = {
    "tree_with_one_child_again_and_again": ("refused", all_the_same),
    "tree_doubling_2_levels": ("refused", doubling(2, 2)),
    "tree_doubling_24_levels": ("refused", doubling(24, 2)),
    "tree_20_times_5_levels": ("refused", doubling(5, 20)),
    "tree_its_own_child_3_levels": ("refused", own_child(3)),
    "tree_its_own_child_65535_levels": ("refused", own_child(65535)),
    "tree_of_depth_65535": ("refused", at(tree, 12, "H", 65535)),
    "tree_of_depth_0": ("refused", at(tree, 12, "H", 0)),
    "tree_of_depth_2": ("refused", at(tree, 12, "H", 2)),
    "tree_root_beyond_the_end": ("refused", at(tree, 16, "Q", 1 << 50)),
    "tree_root_of_nothing": ("refused", at(tree, 16, "Q", NONE)),
    "tree_root_is_its_header": ("refused", lambda f: f.poke(tree(f) + 16, "Q", tree(f))),
    "tree_root_with_no_records": ("refused", at(tree, 24, "H", 0)),
    "tree_root_with_65535_records": ("refused", at(tree, 24, "H", 65535)),
    "tree_root_with_one_record": ("refused", at(tree, 24, "H", 1)),
    "tree_of_2_to_the_63_records": ("refused", at(tree, 26, "Q", 2**63)),
    "tree_of_no_records": ("refused", at(tree, 26, "Q", 0)),
    "tree_of_one_record": ("refused", at(tree, 26, "Q", 1)),
    "tree_nodes_of_0_bytes": ("refused", at(tree, 6, "I", 0)),
    "tree_nodes_of_16_bytes": ("refused", at(tree, 6, "I", 16)),
    "tree_nodes_of_2_gib": ("refused", at(tree, 6, "I", 2**31 - 1)),
    "tree_nodes_of_4_gib": ("refused", at(tree, 6, "I", 2**32 - 1)),
    "tree_nodes_of_64_mib": ("refused", at(tree, 6, "I", 1 << 26)),
    "tree_records_of_0_bytes": ("refused", at(tree, 10, "H", 0)),
    "tree_records_of_1_byte": ("refused", at(tree, 10, "H", 1)),
    "tree_records_of_65535_bytes": ("refused", at(tree, 10, "H", 65535)),
    "tree_splits_at_0": ("either", at(tree, 14, "BB", 0, 0)),
    "tree_splits_at_255": ("either", at(tree, 14, "BB", 255, 255)),
    "tree_of_version_77": ("refused", at(tree, 4, "B", 77)),
    "tree_of_other_records": ("refused", at(tree, 5, "B", 8)),
    "tree_of_testing_records": ("refused", at(tree, 5, "B", 0)),
    "tree_of_unknown_records": ("refused", at(tree, 5, "B", 200)),
    "tree_of_another_group": ("refused", another_tree),
    "node_child_is_the_node": ("refused", lambda f: f.poke(children(f), "Q", root(f))),
    "node_child_beyond": ("refused", lambda f: f.poke(children(f), "Q", 1 << 50)),
    "node_child_of_no_records": ("refused", lambda f: f.poke(children(f) + 8, "B", 0)),
    "node_child_of_255_records": ("refused", lambda f: f.poke(children(f) + 8, "B", 255)),
    "node_child_of_46_records": ("refused", lambda f: f.poke(children(f) + 8, "B", 46)),
    "leaf_of_other_records": ("refused", at(leaf, 5, "B", 8)),
    "leaf_of_one_record": ("refused", same_record),
    "leaf_hashes_fall": ("either", at(leaf, 6, "I", 2**32 - 1)),
    "leaf_record_is_huge": ("refused", at(leaf, 10, "B", 0x10)),
    "leaf_record_is_tiny": ("refused", at(leaf, 10, "B", 0x20)),
    "leaf_record_of_version_3": ("refused", at(leaf, 10, "B", 0xC0)),
    "leaf_record_beyond_the_heap": ("refused", at(leaf, 11, "I", 2**32 - 1)),
    "leaf_record_of_65535_bytes": ("refused", at(leaf, 15, "H", 65535)),
    "leaf_record_of_0_bytes": ("refused", at(leaf, 15, "H", 0)),
    "leaf_record_at_a_block": ("refused", at(leaf, 11, "I", 0)),
    "heap_root_is_the_heap": ("refused", lambda f: f.poke(heap(f) + 132, "Q", heap(f))),
    "heap_root_of_nothing": ("refused", at(heap, 132, "Q", NONE)),
    "heap_root_beyond": ("refused", at(heap, 132, "Q", 1 << 50)),
    "heap_of_no_width": ("refused", at(heap, 110, "H", 0)),
    "heap_of_width_3": ("refused", at(heap, 110, "H", 3)),
    "heap_of_width_65535": ("refused", at(heap, 110, "H", 65535)),
    "heap_of_width_32768": ("refused", at(heap, 110, "H", 32768)),
    "heap_starts_with_0": ("refused", at(heap, 112, "Q", 0)),
    "heap_starts_with_3": ("refused", at(heap, 112, "Q", 3)),
    "heap_starts_with_2_to_the_63": ("refused", at(heap, 112, "Q", 2**63)),
    "heap_starts_with_a_gib": ("refused", at(heap, 112, "Q", 1 << 30)),
    "heap_blocks_of_0": ("refused", at(heap, 120, "Q", 0)),
    "heap_blocks_of_2_to_the_63": ("refused", at(heap, 120, "Q", 2**63)),
    "heap_of_0_bits": ("refused", at(heap, 128, "H", 0)),
    "heap_of_64_bits": ("refused", at(heap, 128, "H", 64)),
    "heap_of_65535_bits": ("refused", at(heap, 128, "H", 65535)),
    "heap_starts_with_65535_rows": ("either", at(heap, 130, "H", 65535)),
    "heap_of_65535_rows": ("refused", at(heap, 140, "H", 65535)),
    "heap_of_40_rows": ("refused", at(heap, 140, "H", 40)),
    "heap_of_no_rows": ("refused", at(heap, 140, "H", 0)),
    "heap_ids_of_0_bytes": ("either", at(heap, 5, "H", 0)),
    "heap_ids_of_1_byte": ("either", at(heap, 5, "H", 1)),
    "heap_ids_of_65535_bytes": ("either", at(heap, 5, "H", 65535)),
    "heap_filters_of_65535_bytes": ("refused", at(heap, 7, "H", 65535)),
    "heap_filters_of_8_bytes": ("refused", at(heap, 7, "H", 8)),
    "heap_without_checksums": ("either", at(heap, 9, "B", 0)),
    "heap_flags_255": ("either", at(heap, 9, "B", 255)),
    "heap_objects_of_4_gib": ("either", at(heap, 10, "I", 2**32 - 1)),
    "heap_objects_of_0": ("refused", at(heap, 10, "I", 0)),
    "heap_huge_objects_in_itself": ("either", lambda f: f.poke(heap(f) + 22, "Q", heap(f))),
    "heap_free_space_in_itself": ("either", lambda f: f.poke(heap(f) + 38, "Q", heap(f))),
    "heap_space_of_2_to_the_63": ("either", at(heap, 46, "QQQQ", 2**63, 2**63, 2**63, 2**63)),
    "heap_space_of_nothing": ("either", at(heap, 46, "QQQQ", 0, 0, 0, 0)),
    "heap_of_version_77": ("refused", at(heap, 4, "B", 77)),
    "block_of_another_heap": ("refused", lambda f: f.poke(block(f) + 5, "Q", links(f, "curves")[0])),
    "block_at_another_offset": ("refused", at(block, 13, "I", 512)),
    "block_of_version_77": ("refused", at(block, 4, "B", 77)),
    "blocks_below_are_the_block": ("refused", lambda f: f.poke(indirect(f) + 17, "QQQQ", *[indirect(f)] * 4)),
    "blocks_below_are_one": ("refused", lambda f: f.poke(indirect(f) + 17, "QQQQ", *[f.peek(indirect(f) + 17, "Q")] * 4)),
    "blocks_below_are_nowhere": ("refused", lambda f: f.poke(indirect(f) + 17, "QQQQ", *[NONE] * 4)),
    "blocks_below_are_beyond": ("refused", lambda f: f.poke(indirect(f) + 17, "Q", 1 << 50)),
    "link_name_of_255": ("refused", at(link_message, 2, "B", 255)),
    "link_name_of_0": ("refused", at(link_message, 2, "B", 0)),
    "link_name_with_a_zero": ("refused", at(link_message, 5, "B", 0)),
    "link_name_with_a_slash": ("refused", at(link_message, 5, "B", 47)),
    "link_name_of_dots": ("refused", at(link_message, 3, "7s", b".......")),
    "link_name_of_another": ("refused", at(link_message, 3, "7s", b"more001")),
    "link_name_of_escapes": ("refused", at(link_message, 3, "7s", b"\x1b[2Jabc")),
    "link_of_version_77": ("refused", at(link_message, 0, "B", 77)),
    "link_flags_255": ("refused", at(link_message, 1, "B", 255)),
    "link_name_length_of_8_bytes": ("refused", at(link_message, 1, "B", 3)),
    "link_soft": ("refused", at(link_message, 1, "BB", 8, 1)),
    "link_to_another_file": ("refused", at(link_message, 1, "BB", 8, 64)),
    "link_of_a_user": ("refused", at(link_message, 1, "BB", 8, 255)),
    "link_to_the_root": ("refused", linked("/")),
    "link_to_its_own_group": ("refused", linked("weights")),
    "link_to_another_array": ("refused", linked("embedding/mean")),
    "link_to_a_heap": ("refused", lambda f: f.poke(link_message(f) + 10, "Q", heap(f))),
    "link_to_nothing": ("refused", at(link_message, 10, "Q", NONE)),
    "superblock_root_is_an_array": ("refused", lambda f: f.poke(36, "Q", f.header("embedding/mean"))),
    "superblock_root_is_a_group": ("refused", lambda f: f.poke(36, "Q", f.header("weights"))),
    "superblock_root_is_nothing": ("refused", lambda f: f.poke(36, "Q", NONE)),
    "superblock_ends_early": ("refused", lambda f: f.poke(28, "Q", 5000)),
    "superblock_ends_late": ("refused", lambda f: f.poke(28, "Q", 1 << 40)),
    "superblock_begins_elsewhere": ("refused", lambda f: f.poke(12, "Q", 0)),
    "superblock_extension_is_itself": ("refused", lambda f: f.poke(20, "Q", 0)),
    "superblock_extension_is_the_root": ("either", lambda f: f.poke(20, "Q", f.peek(36, "Q"))),
    "superblock_being_written": ("either", lambda f: f.poke(11, "B", 5)),
    "superblock_of_version_2": ("either", lambda f: f.poke(8, "B", 2)),
    "superblock_of_version_77": ("refused", lambda f: f.poke(8, "B", 77)),
    "superblock_addresses_of_4_bytes": ("refused", lambda f: f.poke(9, "BB", 4, 4)),
    "superblock_addresses_of_255_bytes": ("refused", lambda f: f.poke(9, "BB", 255, 255)),
    "superblock_with_a_driver": ("refused", extension(b"\0NCSAfami" + struct.pack("<HQ", 8, 1), 0x14)),
    "superblock_with_tree_sizes_of_0": ("either", extension(b"\0" + struct.pack("<HHH", 0, 0, 0), 0x13)),
    "superblock_with_shared_messages": ("refused", extension(b"\0" + struct.pack("<QB", 4096, 8), 0x0F)),
    "superblock_with_free_space": ("either", extension(b"\x01\x01\x01" + struct.pack("<QQHQ", 1, 4096, 0, NONE) + bytes([255]) * 96, 0x17)),
    "superblock_with_a_cache_image": ("refused", extension(b"\0" + struct.pack("<QQ", 4096, 1 << 30), 0x18)),
    "superblock_with_a_cache_image_of_nothing": ("either", extension(b"\0" + struct.pack("<QQ", NONE, 0), 0x18)),
}  # fmt: skip
for name, (right, damage) in DAMAGES.items():
    add(f"groups_v2.{name}", damaged(damage), right)
