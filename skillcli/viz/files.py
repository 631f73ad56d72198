"""Files that appear whole or not at all, one or several together."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillcli.errors import SkillError

FORMATS = ("png", "pdf", "svg")  # of figures
TEMPORARY = ".tmp-"  # as the store names unfinished files, so that `skill gc` knows those in its folder for what they are


@contextmanager
def replacing(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield a temporary path beside each of `paths`; when the block succeeds they get their names, on the disk for good.

    Raises:
        SkillError: a folder or the disk does not take a file; whatever was at `paths` before is untouched.
    """
    temporary = tuple(map(_beside, paths))
    path = paths[0] if paths else Path()
    try:
        for path, unfinished in zip(paths, temporary, strict=True):
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            unfinished.touch(exist_ok=False)  # said before the work
        yield temporary
        for unfinished in temporary:
            _flush(unfinished)
        for path, unfinished in zip(paths, temporary, strict=True):
            unfinished.replace(path)
        for folder in {one.parent for one in paths}:
            _flush(folder)
    except OSError as error:
        reason = error.strerror or str(error)
        raise SkillError(f"cannot write {path}: {reason}", "choose another folder, or free some space") from error
    finally:
        for unfinished in temporary:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)


def _beside(path: Path) -> Path:
    return path.with_name(f"{TEMPORARY}{path.stem.lstrip('.')[:40]}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
