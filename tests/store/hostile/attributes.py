"""Attributes of the file, its groups and its arrays: only what the store writes, as it writes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

from .case import add
from .forge import Tamper, attribute
from .good import Good


def tampered(tamper: Tamper) -> Callable[[Good], bytes]:
    return lambda good: good.forged().file(tamper)


def put(where: str, name: str, value: Any, dtype: Any = None, shape: Any = None) -> Tamper:
    """Create or replace an attribute."""

    def tamper(file: h5py.File) -> None:
        if name in file[where].attrs:
            del file[where].attrs[name]
        if dtype is None and shape is None:
            attribute(file[where], name, value)
        else:
            file[where].attrs.create(name, value, dtype=dtype, shape=shape)

    return tamper


def fixed(length: int, encoding: str = "utf-8") -> Any:
    return h5py.string_dtype(encoding, length)


def padded(kind: int, charset: int) -> Tamper:
    """The kind of artifact as a text of another padding or alphabet."""

    def tamper(file: h5py.File) -> None:
        del file.attrs["kind"]
        form = h5py.h5t.C_S1.copy()
        form.set_size(12)
        form.set_strpad(kind)
        form.set_cset(charset)
        made = h5py.h5a.create(file.id, b"kind", form, h5py.h5s.create(h5py.h5s.SCALAR))
        made.write(np.array(b"pretrain", "S12"), mtype=form)

    return tamper


def removed(where: str, name: str) -> Tamper:
    def tamper(file: h5py.File) -> None:
        del file[where].attrs[name]

    return tamper


def many(file: h5py.File) -> None:
    for i in range(17):
        file["weights"].attrs.create(f"a{i}", np.int64(i))


def many_on_one(file: h5py.File) -> None:
    for i in range(60_000):
        file["embedding/mean"].attrs.create(f"a{i}", np.int64(i))


MEAN = "embedding/mean"
for name, tamper in {
    "dimensions_of_another_rank": put(MEAN, "dimensions", "skill,latent,more"),
    "dimensions_of_fewer": put(MEAN, "dimensions", "skill"),
    "dimensions_with_other_names": put(MEAN, "dimensions", "latent,skill"),
    "dimensions_of_4_kB": put(MEAN, "dimensions", "x" * 4096),
    "dimensions_of_markup": put(MEAN, "dimensions", "[/],[red]"),
    "dimensions_of_escapes": put(MEAN, "dimensions", "\x1b[2J,latent"),
    "dimensions_are_a_number": put(MEAN, "dimensions", 2),
    "dimensions_not_utf8": put(MEAN, "dimensions", b"\xff\xfe"),
    "no_dimensions": removed(MEAN, "dimensions"),
    "other_unit": put("skills/goal", "unit", "mile"),
    "no_unit": removed("skills/goal", "unit"),
    "unknown_name_on_an_array": put(MEAN, "note", "x"),
    "unknown_name_on_a_group": put("embedding", "note", "x"),
    "unknown_name_on_the_file": put("/", "note", 1),
    "dimension_list_as_hdf5_makes_it": put(MEAN, "DIMENSION_LABELS", 3),
    "name_of_60_kB": put(MEAN, "n" * 60_000, 1),
    "name_of_escapes": put(MEAN, "\x1b[2J", 1),
    "name_of_nothing": put(MEAN, " ", 1),
    "kind_of_4_kB": put("/", "kind", "pretrain" * 512),
    "kind_of_60_kB": put("/", "kind", "pretrain" * 7500),
    "kind_with_a_zero_inside": put("/", "kind", b"pretrain\0\0more"),
    "kind_padded_with_zeros": put("/", "kind", b"pretrain".ljust(64, b"\0"), fixed(64)),
    "kind_padded_with_spaces": put("/", "kind", "pretrain    "),
    "kind_as_ascii": put("/", "kind", np.bytes_(b"pretrain"), fixed(8, "ascii")),
    "kind_of_variable_length": put("/", "kind", "pretrain", h5py.string_dtype()),
    "kind_space_padded_type": padded(2, 1),
    "kind_zero_ended_type": padded(0, 1),
    "kind_null_padded_ascii_type": padded(1, 0),
    "kind_twice_in_a_list": put("/", "kind", np.array([b"pretrain"] * 2), fixed(8), (2,)),
    "kind_in_a_list_of_one": put("/", "kind", np.array([b"pretrain"]), fixed(8), (1,)),
    "seed_without_sign": put("/", "seed", np.uint64(0), "u8"),
    "seed_of_32_bits": put("/", "seed", np.int32(0), "i4"),
    "seed_of_8_bits": put("/", "seed", np.int8(0), "i1"),
    "seed_of_the_other_end": put("/", "seed", np.array(0, ">i8"), ">i8"),
    "seed_is_a_truth": put("/", "seed", np.bool_(False), bool),
    "seed_is_a_fraction": put("/", "seed", 0.0, "f8"),
    "seed_in_a_list": put("/", "seed", np.array([0]), "i8", (1,)),
    "seed_is_empty": put("/", "seed", h5py.Empty("i8")),
    "seed_is_a_text": put("/", "seed", "0"),
    "seed_is_a_compound": put("/", "seed", np.array((0, 1), [("a", "i8"), ("b", "i8")])),
    "seed_is_a_reference": put("/", "seed", None, h5py.ref_dtype),
    "dirty_is_two": put("/", "git_dirty", 2),
    "dirty_is_a_text": put("/", "git_dirty", "0"),
    "schema_differs": put("/", "schema_version", 2),
    "no_kind": removed("/", "kind"),
    "commit_is_a_number": put("/", "git_commit", 12),
    "commit_of_markup": put("/", "git_commit", "[/]" * 4),
    "commit_of_escapes": put("/", "git_commit", "\x1b[2J" * 3),
    "commit_of_4_kB": put("/", "git_commit", "a" * 4096),
    "model_is_a_number": put("/", "model_sha256", 12),
    "model_differs": put("/", "model_sha256", "0" * 64),
    "recipe_hash_differs": put("/", "recipe_sha256", "0" * 64),
    "17_on_a_group": many,
    "60000_on_an_array": many_on_one,
}.items():
    add(f"attributes.{name}", tampered(tamper))
