"""Which files were written here, on this account: their hashes, one a line, in the user's cache.

What was written here may be parsed by libhdf5 in this process; anything else, also a store that somebody sent as a whole, is
read in a process of its own. Losing the list costs a moment for every file, nothing else.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path

from skillcli.cache import user_cache

_LONGEST = 1 << 24  # bytes of the list, a quarter of a million files; then the older half is forgotten


def is_known(digest: str) -> bool:
    """Whether the file with this hash was written here."""
    return digest in _digests()


def remember(digest: str) -> None:
    """Take note of a file that is being written. A list that cannot be written is as good as none."""
    if digest in _digests():
        return
    _digests().add(digest)
    with suppress(OSError, RuntimeError):  # no home at all
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
