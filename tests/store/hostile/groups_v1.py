# ruff: noqa: E501 - tables of one case a line
"""Groups and chunk indexes of HDF5's first format: B-trees of version 1, symbol tables, local heaps."""

from __future__ import annotations

import struct
from collections.abc import Callable

from .case import Right, add
from .good import Good
from .layout import NONE, Bytes

Damage = Callable[[Bytes], object]
GROUP, CHUNKS = b"TREE\x00", b"TREE\x01"
ROOT_TREE, ROOT_HEAP = 136, 680
LINK, CHUNK = 24, 24  # behind the head of a node: first a key, then a child
CHUNK_KEY = 8 + 8 * 4  # of a dataset of three dimensions: size, mask, four offsets


def old(good: Good) -> Bytes:
    """The good file in the format of 1998."""
    copy = good.forged()
    copy.libver = ("earliest", "v110")
    return Bytes(copy.file())


def damaged(damage: Damage) -> Callable[[Good], bytes]:
    def build(good: Good) -> bytes:
        file = old(good)
        damage(file)
        return file.file()

    return build


def weights_tree(file: Bytes) -> int:
    """The B-tree of the largest group."""
    place = file.at(file.header("weights"))
    message = file.data.index(struct.pack("<HH", 0x11, 16), place)  # of its header: where the symbol table lies
    return int(struct.unpack_from("<Q", file.data, message + 8)[0])


def weights_heap(file: Bytes) -> int:
    place = file.at(file.header("weights"))
    return int(struct.unpack_from("<Q", file.data, file.data.index(struct.pack("<HH", 0x11, 16), place) + 16)[0])


def action_tree(file: Bytes) -> int:
    """The B-tree of the chunks of trajectories/action, of three dimensions."""
    return file.find(CHUNKS, after=file.header("trajectories/action"))


def node(kind: int, level: int, children: list[int], *, left: int = NONE, right: int = NONE, used: int | None = None) -> bytes:
    """A node of a B-tree of version 1: of groups (kind 0) or of chunks of 3 dimensions (kind 1)."""
    keys = [
        struct.pack("<Q", 8 * i) if kind == 0 else struct.pack("<II4Q", 14404, 0, i, 0, 0, 0) for i in range(len(children) + 1)
    ]
    pairs = b"".join(key + struct.pack("<Q", child) for key, child in zip(keys, children, strict=False))
    head = b"TREE" + struct.pack("<BBHQQ", kind, level, len(children) if used is None else used, left, right)
    return (head + pairs + keys[-1]).ljust(2096 if kind else 544, b"\0")


def own_child(tree: Callable[[Bytes], int], child: int) -> Damage:
    """A node one level up whose child is itself."""
    return lambda file: file.poke(tree(file) + 5, "B", 1).poke(tree(file) + child, "Q", tree(file))


def put(tree: Callable[[Bytes], int], offset: int, form: str, *values: int) -> Damage:
    return lambda file: file.poke(tree(file) + offset, form, *values)


def mutual(kind: int, tree: Callable[[Bytes], int], child: int) -> Damage:
    """Two nodes of the levels 2 and 1 that are each other's children."""

    def damage(file: Bytes) -> None:
        first = tree(file)
        second = file.append(node(kind, 1, [first]))
        file.poke(first + 5, "B", 2).poke(first + child, "Q", second)

    return damage


def siblings(kind: int, tree: Callable[[Bytes], int]) -> Damage:
    """Two nodes that are each other's neighbours, on both sides."""

    def damage(file: Bytes) -> None:
        first = tree(file)
        second = file.append(
            node(kind, 0, [file.peek(first + (32 if kind == 0 else 24 + CHUNK_KEY), "Q")], left=first, right=first)
        )
        file.poke(first + 8, "QQ", second, second)

    return damage


def doubling(kind: int, tree: Callable[[Bytes], int], child: int, levels: int, width: int) -> Damage:
    """Each node names the next one below several times: few nodes, and no end of ways through them."""

    def damage(file: Bytes) -> None:
        below = file.peek(tree(file) + child, "Q")
        for level in range(levels):
            below = file.append(node(kind, level, [below] * width))
        file.poke(tree(file) + 5, "B", levels).poke(tree(file) + child, "Q", below)

    return damage


def symbols(file: Bytes) -> int:
    """The first node of symbols of the largest group."""
    return file.peek(weights_tree(file) + LINK + 8, "Q")


def heap_data(file: Bytes) -> int:
    return file.peek(weights_heap(file) + 24, "Q")


def all_free(file: Bytes) -> None:
    """The list of free pieces of a heap runs in a circle."""
    file.poke(weights_heap(file) + 16, "Q", 8).poke(heap_data(file) + 8, "QQ", 8, 16)


def names_without_end(file: Bytes) -> None:
    """Not one zero in a heap of names."""
    size = file.peek(weights_heap(file) + 8, "Q")
    start = file.at(heap_data(file))
    file.data[start : start + size] = b"a" * size


def one_name_for_all(file: Bytes) -> None:
    for entry in range(file.peek(symbols(file) + 6, "H")):
        file.poke(symbols(file) + 8 + 40 * entry, "Q", 8)


def the_root_again(file: Bytes) -> None:
    """The symbol table of a group is that of the root: a folder inside itself, without a link to it."""
    place = file.data.index(struct.pack("<HH", 0x11, 16), file.at(file.header("weights")))
    struct.pack_into("<QQ", file.data, place + 8, ROOT_TREE, ROOT_HEAP)


GROUPS: dict[str, tuple[Right, Damage]] = {
    "group_is_its_own_child": ("refused", own_child(weights_tree, LINK + 8)),
    "root_is_its_own_child": ("refused", own_child(lambda _: ROOT_TREE, LINK + 8)),
    "group_is_its_last_child": ("refused", own_child(weights_tree, LINK + 8 + 16 * 3)),
    "group_of_level_1_with_symbols_below": ("refused", put(weights_tree, 5, "B", 1)),
    "group_of_level_255": ("refused", put(weights_tree, 5, "B", 255)),
    "group_mutual_children": ("refused", mutual(0, weights_tree, LINK + 8)),
    "group_its_own_right_sibling": ("refused", lambda f: f.poke(weights_tree(f) + 16, "Q", weights_tree(f))),
    "group_its_own_left_sibling": ("either", lambda f: f.poke(weights_tree(f) + 8, "Q", weights_tree(f))),
    "group_mutual_siblings": ("refused", siblings(0, weights_tree)),
    "group_siblings_beyond_the_end": ("either", put(weights_tree, 8, "QQ", 1 << 60, 1 << 60)),
    "group_doubling_25_levels": ("refused", doubling(0, weights_tree, LINK + 8, 25, 2)),
    "group_deep_60_levels": ("either", doubling(0, weights_tree, LINK + 8, 60, 1)),
    "group_32_times_4_levels": ("refused", doubling(0, weights_tree, LINK + 8, 4, 32)),
    "group_with_65535_used": ("refused", put(weights_tree, 6, "H", 65535)),
    "group_with_33_used": ("refused", put(weights_tree, 6, "H", 33)),
    "group_with_none_used": ("refused", put(weights_tree, 6, "H", 0)),
    "group_child_of_nothing": ("refused", put(weights_tree, LINK + 8, "Q", NONE)),
    "group_child_beyond_the_end": ("refused", put(weights_tree, LINK + 8, "Q", 1 << 40)),
    "group_child_at_the_superblock": ("refused", put(weights_tree, LINK + 8, "Q", 0)),
    "group_child_wraps_around": ("refused", put(weights_tree, LINK + 8, "Q", 2**64 - 4096)),
    "group_keys_fall": ("either", put(weights_tree, LINK, "Q", 1 << 40)),
    "group_is_a_chunk_tree": ("refused", put(weights_tree, 4, "B", 1)),
    "group_points_to_a_chunk_tree": ("refused", lambda f: f.poke(weights_tree(f) + 32, "Q", action_tree(f))),
    "symbols_65535": ("refused", put(symbols, 6, "H", 65535)),
    "symbols_none": ("refused", put(symbols, 6, "H", 0)),
    "symbols_of_version_9": ("refused", put(symbols, 4, "B", 9)),
    "symbols_name_beyond_the_heap": ("refused", put(symbols, 8, "Q", 1 << 40)),
    "symbols_name_at_the_last_byte": ("refused", lambda f: f.poke(symbols(f) + 8, "Q", f.peek(weights_heap(f) + 8, "Q") - 1)),
    "symbols_one_name_for_all": ("refused", one_name_for_all),
    "symbols_object_is_the_root": ("refused", put(symbols, 16, "Q", 96)),
    "symbols_object_is_its_own_group": ("refused", lambda f: f.poke(symbols(f) + 16, "Q", f.header("weights"))),
    "symbols_object_is_the_next": ("refused", lambda f: f.poke(symbols(f) + 16, "Q", f.peek(symbols(f) + 56, "Q"))),
    "symbols_object_beyond_the_end": ("refused", put(symbols, 16, "Q", 1 << 50)),
    "symbols_soft_link": ("refused", put(symbols, 24, "III", 2, 0, 8)),
    "symbols_group_cached_elsewhere": ("either", lambda f: f.poke(symbols(f) + 24, "IIQQ", 1, 0, ROOT_TREE, ROOT_HEAP)),
    "symbols_cache_of_type_77": ("refused", put(symbols, 24, "I", 77)),
    "symbols_twice": ("refused", lambda f: f.poke(weights_tree(f) + 48, "Q", symbols(f))),
    "heap_of_a_petabyte": ("refused", put(weights_heap, 8, "Q", 1 << 50)),
    "heap_of_a_gib": ("refused", put(weights_heap, 8, "Q", 1 << 30)),
    "heap_of_nothing": ("refused", put(weights_heap, 8, "Q", 0)),
    "heap_data_is_the_heap": ("refused", lambda f: f.poke(weights_heap(f) + 24, "Q", weights_heap(f))),
    "heap_free_list_in_a_circle": ("refused", all_free),
    "heap_free_list_beyond": ("refused", put(weights_heap, 16, "Q", 1 << 40)),
    "heap_names_without_end": ("refused", names_without_end),
    "heap_of_another_group": ("refused", lambda f: f.poke(weights_heap(f) + 24, "Q", f.peek(ROOT_HEAP + 24, "Q"))),
    "group_with_the_roots_symbols": ("refused", the_root_again),
    "chunks_their_own_child": ("refused", own_child(action_tree, CHUNK + CHUNK_KEY)),
    "chunks_mutual_children": ("refused", mutual(1, action_tree, CHUNK + CHUNK_KEY)),
    "chunks_their_own_right_sibling": ("either", lambda f: f.poke(action_tree(f) + 16, "Q", action_tree(f))),
    "chunks_mutual_siblings": ("either", siblings(1, action_tree)),
    "chunks_doubling_25_levels": ("refused", doubling(1, action_tree, CHUNK + CHUNK_KEY, 25, 2)),
    "chunks_deep_200_levels": ("either", doubling(1, action_tree, CHUNK + CHUNK_KEY, 200, 1)),
    "chunks_50_times_4_levels": ("refused", doubling(1, action_tree, CHUNK + CHUNK_KEY, 4, 50)),
    "chunks_of_level_255": ("refused", put(action_tree, 5, "B", 255)),
    "chunks_with_65535_used": ("refused", put(action_tree, 6, "H", 65535)),
    "chunks_with_none_used": ("refused", put(action_tree, 6, "H", 0)),
    "chunk_of_4_gib": ("refused", put(action_tree, CHUNK, "I", 2**32 - 1)),
    "chunk_of_nothing": ("refused", put(action_tree, CHUNK, "I", 0)),
    "chunk_of_three_bytes": ("refused", put(action_tree, CHUNK, "I", 3)),
    "chunk_without_filters": ("either", put(action_tree, CHUNK + 4, "I", 0xFFFFFFFF)),
    "chunk_at_the_superblock": ("refused", put(action_tree, CHUNK + CHUNK_KEY, "Q", 0)),
    "chunk_beyond_the_end": ("refused", put(action_tree, CHUNK + CHUNK_KEY, "Q", 1 << 50)),
    "chunk_of_nowhere": ("refused", put(action_tree, CHUNK + CHUNK_KEY, "Q", NONE)),
    "chunk_offset_beyond": ("refused", put(action_tree, CHUNK + 8, "Q", 1 << 50)),
    "chunk_offset_within": ("refused", put(action_tree, CHUNK + 8, "Q", 7)),
    "chunks_are_a_group": ("refused", put(action_tree, 4, "B", 0)),
    "chunks_point_to_a_group": ("refused", lambda f: f.poke(action_tree(f) + 5, "B", 1).poke(action_tree(f) + 64, "Q", weights_tree(f))),
    "superblock_leaf_of_0": ("refused", lambda f: f.poke(16, "H", 0)),
    "superblock_leaf_of_65535": ("either", lambda f: f.poke(16, "H", 65535)),
    "superblock_nodes_of_0": ("refused", lambda f: f.poke(18, "H", 0)),
    "superblock_nodes_of_65535": ("either", lambda f: f.poke(18, "H", 65535)),
    "superblock_addresses_of_255_bytes": ("refused", lambda f: f.poke(13, "B", 255)),
    "superblock_addresses_of_0_bytes": ("refused", lambda f: f.poke(13, "B", 0)),
    "superblock_sizes_of_32_bytes": ("refused", lambda f: f.poke(14, "B", 32)),
    "superblock_begins_elsewhere": ("refused", lambda f: f.poke(24, "Q", 4097)),
    "superblock_ends_early": ("refused", lambda f: f.poke(40, "Q", 5000)),
    "superblock_ends_late": ("refused", lambda f: f.poke(40, "Q", 1 << 40)),
    "superblock_ends_nowhere": ("refused", lambda f: f.poke(40, "Q", NONE)),
    "superblock_free_space": ("either", lambda f: f.poke(32, "Q", 96)),
    "superblock_driver": ("refused", lambda f: f.poke(48, "Q", 96)),
    "superblock_root_is_an_array": ("refused", lambda f: f.poke(64, "Q", f.header("trajectories/action"))),
    "superblock_root_is_a_group": ("refused", lambda f: f.poke(64, "Q", f.header("weights"))),
    "superblock_root_tree_cached_elsewhere": ("either", lambda f: f.poke(80, "QQ", weights_tree(f), weights_heap(f))),
    "superblock_of_version_1": ("either", lambda f: f.poke(8, "B", 1)),
    "superblock_of_version_77": ("refused", lambda f: f.poke(8, "B", 77)),
}  # fmt: skip
for name, (right, damage) in GROUPS.items():
    add(f"groups_v1.{name}", damaged(damage), right)
