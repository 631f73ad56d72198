"""Write one or several files so that they appear complete or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillcli.errors import SkillError

TEMPORARY = ".tmp-"  # prefix of the store's unfinished files, so that `skill gc` finds them in its folder


@contextmanager
def replacing(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield a temporary path beside each of `paths`; after the block, flush the files and rename them.

    Raises:
        SkillError: a folder or the disk refuses a file; the files at `paths` are unchanged.
    """
    temporary = tuple(map(_beside, paths))
    path = paths[0] if paths else Path()
    try:
        for path, unfinished in zip(paths, temporary, strict=True):
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            unfinished.touch(exist_ok=False)  # fail before the work
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
