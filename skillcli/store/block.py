"""The block at the start of every stored file: one line with the file's own hash, one line of JSON, zeros.

It lies in HDF5's user block, so any HDF5 tool opens the file, and listing a store reads a few kilobytes per file and opens
no HDF5. The hash covers every byte of the file except its own 64 digits, so any changed bit is found.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from typing import Any, BinaryIO

from skillcli.store.canonical_json import canonical, parse

MAGIC = b"skill-store "
"""First bytes of every file of a store."""

SMALLEST = 4096
LARGEST = 1 << 17

_LINE = "skill-store 1 block={:07d} sha256={}\n"
_PATTERN = re.compile(rb"skill-store 1 block=([0-9]{7}) sha256=([0-9a-f]{64})\n")
_LENGTH = len(_LINE.format(0, "0" * 64))
_DIGITS = slice(_LENGTH - 65, _LENGTH - 1)


def block_size(header: Mapping[str, Any]) -> int:
    """Return the smallest block size that HDF5 allows (a power of two) and that holds `header`.

    Raises:
        ValueError: none does.
    """
    needed = _LENGTH + len(canonical(header)) + 1
    size = SMALLEST
    while size < needed:
        size *= 2
    if size > LARGEST:
        raise ValueError(f"the header takes {needed} bytes, at most {LARGEST} fit")
    return size


def seal(file: BinaryIO, header: Mapping[str, Any], size: int) -> str:
    """Write the block into the first `size` bytes of a finished file, the file's hash last; return that hash."""
    line = _LINE.format(size, "0" * 64)
    file.seek(0)
    file.write(f"{line}{canonical(header)}\n".encode().ljust(size, b"\0"))
    digits = digest(file)
    file.seek(_DIGITS.start)
    file.write(digits.encode())
    return digits


def read_block(file: BinaryIO) -> tuple[dict[str, Any], int]:
    """Return the header and the size of its block; the rest of the file is not checked.

    Raises:
        ValueError: this is not a file of a store, or its block is damaged.
    """
    file.seek(0)
    start = file.read(SMALLEST)
    found = _PATTERN.match(start)
    if not found:
        raise ValueError("it does not begin as a file of this store does")
    size = int(found[1])
    if not SMALLEST <= size <= LARGEST or size & (size - 1):
        raise ValueError(f"its header block has an impossible size, {size}")
    if size > len(start):
        start += file.read(size - len(start))
    text, _, padding = start[_LENGTH:].partition(b"\n")
    if len(start) != size or padding != bytes(len(padding)):
        raise ValueError("its header block is cut short or has something behind the header")
    header = parse(text)
    if not isinstance(header, dict):
        raise ValueError("its header is not a JSON object")
    return header, size


def may_mention(file: BinaryIO, text: str) -> bool:
    """Return whether the header may contain a JSON string: faster than parsing it, and never wrongly False."""
    file.seek(0)
    start = file.read(SMALLEST)
    found = _PATTERN.match(start)
    start += file.read(int(found[1]) - len(start)) if found and int(found[1]) > len(start) else b""
    return f'"{text}"'.encode() in start or b"\\" in start  # after a backslash any character may be escaped


def check_digest(file: BinaryIO) -> None:
    """Read the whole file and compare it with the hash in its block.

    Raises:
        ValueError: they differ.
    """
    recorded, actual = recorded_digest(file), digest(file)
    if actual != recorded:
        raise ValueError(f"its bytes have changed: sha256 {recorded[:12]} was recorded, {actual[:12]} is found")


def check_spelling(file: BinaryIO, header: Mapping[str, Any]) -> None:
    """Compare the header's bytes with those that the store would write.

    Raises:
        ValueError: they differ, for example in the order of keys.
    """
    wanted = f"{canonical(header)}\n".encode()
    file.seek(_LENGTH)
    if file.read(len(wanted)) != wanted:
        raise ValueError("its header is not spelled as the store does")


def recorded_digest(file: BinaryIO) -> str:
    """Return the hash recorded in the block, "" if there is none."""
    file.seek(0)
    found = _PATTERN.match(file.read(_LENGTH))
    return found[2].decode() if found else ""


def digest(file: BinaryIO) -> str:
    """Hash every byte of the file but the digits of the hash itself with SHA-256; 64 hexadecimal digits."""
    file.seek(0)
    sha = hashlib.sha256(file.read(_DIGITS.start))
    file.seek(_DIGITS.stop)
    while chunk := file.read(1 << 20):
        sha.update(chunk)
    return sha.hexdigest()
