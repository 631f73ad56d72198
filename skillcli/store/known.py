"""The hashes of all files written here, one per line, in the user's cache.

This process may parse them with libhdf5; any other file is read in a separate process, even if it came with a whole store.
Losing the list costs a moment per file and nothing else.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path

from skillcli.cache import user_cache

_LONGEST = 1 << 24  # bytes of the list, a quarter of a million files; beyond it the older half is dropped


def is_known(digest: str) -> bool:
    """Return whether the file with this hash was written here."""
    return digest in _digests()


def remember(digest: str) -> None:
    """Add the hash of a file that is being written. If the list cannot be written, nothing is remembered."""
    if digest in _digests():
        return
    _digests().add(digest)
    with suppress(OSError, RuntimeError):  # there may be no home folder
        path = _path()
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a") as file:
            file.write(f"{digest}\n")
        if path.stat().st_size > _LONGEST:
            lines = path.read_text().splitlines(keepends=True)
            path.write_text("".join(lines[len(lines) // 2 :]))


def _path() -> Path:
    return user_cache() / "written-here"


@cache
def _digests() -> set[str]:
    with suppress(OSError, RuntimeError, UnicodeDecodeError):
        return set(_path().read_text().split())
    return set()
