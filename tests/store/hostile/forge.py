"""Write artifacts as the store does, without asking the store: whatever they say, their hashes are right."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np

from skillcli.store.schema import labels

LINE = "skill-store 1 block={:07d} sha256={}\n"
START = len(LINE.format(0, "0" * 64))
TEXTS = ("command", "recipe", "results", "measured", "packages", "parents")
SHARED = ("id", "kind", "schema_version", "created_utc", "seed", "content_sha256", "inputs_sha256")
ARRAY = dict[str, Any]

Tamper = Callable[[h5py.File], object]


def canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def sha256(value: Any) -> str:
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def sealed(data: bytes, **changes: Any) -> bytes:
    """A file with the length and the hash it would have if it were honest; `text` is a header word by word."""
    size = int(data[20:27])
    text = changes.pop("text", None)
    if text is None:
        header = json.loads(data[START:size].split(b"\n")[0])
        text = canonical({**header, "bytes": len(data), **changes})
    line = text if isinstance(text, bytes) else text.encode()
    block = LINE.format(size, "0" * 64).encode() + line + b"\n"
    assert len(block) <= size, "the header does not fit in its block"
    file = block.ljust(size, b"\0") + data[size:]
    digest = hashlib.sha256(file[: START - 65] + file[START - 1 :]).hexdigest()
    return file[: START - 65] + digest.encode() + file[START - 1 :]


@dataclass
class Forged:
    """All that the file of an artifact says, to be changed at will."""

    header: dict[str, Any]
    attributes: dict[str, Any]
    texts: dict[str, Any]  # JSON values; bytes are taken word by word
    arrays: dict[str, Any]
    labels: dict[str, tuple[str, str]] = field(default_factory=dict)  # where they are not those of the schema
    libver: tuple[str, str] = ("v110", "v110")
    block: int = 4096

    def file(self, tamper: Tamper = lambda _: None, *, rehash: bool = True, **changes: Any) -> bytes:
        """The bytes of it. `tamper` changes the HDF5 part after all hashes of the content were made."""
        if rehash:
            self.rehash()
        return sealed(self.hdf5(tamper), text=None, **self.header, **changes)

    def rehash(self) -> None:
        """Give header and attributes the hashes of what the arrays and texts are now."""
        self.attributes["recipe_sha256"] = sha256(self.texts["recipe"])
        self.header["content_sha256"] = self.content_hash()
        self.texts["parents"] = self.header["parents"]
        self.attributes |= {name: self.header[name] for name in SHARED}

    def content_hash(self) -> str:
        meaning = {
            "kind": self.header["kind"],
            "schema_version": self.header["schema_version"],
            "seed": self.header["seed"],
            "recipe_sha256": self.attributes["recipe_sha256"],
            "parents": [parent["content_sha256"] for parent in self.header["parents"]],
            "model_sha256": self.attributes["model_sha256"],
            "results": self.texts["results"],
        }
        sha = hashlib.sha256(canonical(meaning).encode())
        for path, array in sorted(self.arrays.items()):
            sha.update(f"\n{canonical([path, array.dtype.str, list(array.shape)])}\n".encode())
            sha.update(np.ascontiguousarray(array).data)
        return sha.hexdigest()

    def hdf5(self, tamper: Tamper = lambda _: None) -> bytes:
        buffer = io.BytesIO()
        with h5py.File(buffer, "w", userblock_size=self.block, libver=self.libver) as file:
            for name, value in self.attributes.items():
                attribute(file, name, value)
            for path, array in sorted((self.arrays | self.text_arrays()).items()):
                dataset(file, path, array, *self.label(path, array.ndim))
            tamper(file)
        data = buffer.getvalue()
        return LINE.format(self.block, "0" * 64).encode() + b"{}\n" + data[START + 3 :]

    def text_arrays(self) -> dict[str, Any]:
        spelled = {k: v if isinstance(v, bytes) else canonical(v).encode() for k, v in self.texts.items()}
        return {f"record/{name}": np.frombuffer(text, np.uint8) for name, text in spelled.items()}

    def label(self, path: str, ndim: int) -> tuple[str, str]:
        own = ("byte", "JSON") if path.startswith("record/") else labels(self.header["kind"], path, ndim)
        return self.labels.get(path, own)


def dataset(file: Any, path: str, array: Any, dimensions: str = "", unit: str = "") -> Any:
    """A dataset stored as the store stores it: chunks with a checksum, but for single numbers and nothing."""
    storage = {"chunks": array.shape, "fletcher32": True} if array.ndim and array.size else {}
    made = file.create_dataset(path, data=array, track_times=False, **storage)
    attribute(made, "dimensions", dimensions)
    attribute(made, "unit", unit)
    return made


def attribute(item: Any, name: str, value: Any) -> None:
    if isinstance(value, int):
        item.attrs.create(name, np.int64(value))
    elif isinstance(value, str | bytes):
        data = value if isinstance(value, bytes) else value.encode()
        item.attrs.create(name, np.bytes_(data), dtype=h5py.string_dtype("utf-8", max(1, len(data))))
    else:
        item.attrs.create(name, value)


def forge(data: bytes) -> Forged:
    """Take a good file apart."""
    header = json.loads(data[START:].split(b"\n")[0])
    del header["bytes"]
    with h5py.File(io.BytesIO(data)) as file:
        arrays: dict[str, Any] = {}
        file.visititems(lambda path, item: arrays.update({path: item[()]}) if isinstance(item, h5py.Dataset) else None)
        attributes = {name: _plain(value) for name, value in file.attrs.items()}
    texts = {name: json.loads(arrays.pop(f"record/{name}").tobytes()) for name in TEXTS}
    return Forged(header, attributes, texts, {path: np.asarray(array) for path, array in arrays.items()})


def _plain(value: Any) -> Any:
    return value.decode() if isinstance(value, bytes) else int(value)
