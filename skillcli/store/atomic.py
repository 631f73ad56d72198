"""Files that are either whole under their final name or not there at all, also after a crash or a power cut."""

from __future__ import annotations

import errno
import os
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TypeVar

from skillcli.errors import StoreError
from skillcli.store.process import is_running, machine_tag

T = TypeVar("T")

TEMPORARY = ".tmp-"
"""How the names of unfinished files begin: `.tmp-WHAT-MACHINE-PID-RANDOM`, left over where a process was killed."""

LEFT_OVER_SECONDS = 24 * 3600.0
"""After this time without a change an unfinished file is left over, wherever its process runs or ran."""

_HINTS = {
    errno.ENOSPC: "the disk is full: free some space, or choose another folder with --store",
    errno.EDQUOT: "the disk quota is used up: free some space, or choose another folder with --store",
    errno.EFBIG: "the file is larger than is allowed here: see `ulimit -f`, or choose another folder with --store",
    errno.EROFS: "the file system is read-only: choose another folder with --store",
    errno.EACCES: "you may not write here: choose another folder with --store",
    errno.EPERM: "you may not write here: choose another folder with --store",
    errno.ENOTDIR: "a file lies where a folder is needed: move it away, or choose another folder with --store",
    errno.EEXIST: "a file lies where a folder or a new artifact is needed: move it away",
}


@contextmanager
def storage_errors(action: str) -> Iterator[None]:
    """Turn what the operating system says while doing `action` into a StoreError with advice."""
    try:
        yield
    except OSError as error:
        hint = _HINTS.get(error.errno or 0, "check the disk and the folder's permissions")
        raise StoreError(f"cannot {action}: {error.strerror or error}", hint) from error


def write_atomically(
    path: Path,
    data: memoryview,
    check: Callable[[Path], T],
    *,
    replace: bool = False,
    naming: AbstractContextManager[object] | None = None,
) -> T:
    """Write `data` beside `path`, flush it to the disk, check it as it is there, and only then give it its name.

    Args:
        path: the final name; its folder exists.
        data: the bytes of the file.
        check: reads the finished temporary file; raises to refuse it.
        replace: whether an existing file may be replaced.
        naming: entered for the moment in which the file gets its name; may raise to refuse it.

    Returns:
        What `check` returned.

    Raises:
        StoreError: the disk refused; nothing was left under `path`, or what was there before still is.
    """
    temporary = temporary_beside(path)
    with storage_errors(f"write {path}"):
        try:
            with temporary.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            checked = check(temporary)
            with naming or nullcontext():
                if not replace and os.path.lexists(path):
                    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
                os.replace(temporary, path)  # noqa: PTH105 - one name for the tests to break
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
        sync_folder(path.parent)
    return checked


def temporary_beside(path: Path) -> Path:
    """A name for the unfinished form of a file, which tells whose it is."""
    return path.with_name(
        f"{TEMPORARY}{path.stem.lstrip('.')}-{machine_tag()}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}"
    )


def is_left_over(path: Path) -> bool:
    """Whether an unfinished file will never be finished: its process has ended, or it has not changed for a day."""
    tag, pid, _ = ["", "", *path.stem.split("-")][-3:]
    if tag == machine_tag() and pid.isascii() and pid.isdigit() and not is_running(int(pid)):
        return True
    try:
        return time.time() - path.lstat().st_mtime > LEFT_OVER_SECONDS
    except OSError:  # finished or removed meanwhile
        return False


def make_folder(path: Path) -> None:
    """Create a folder and its parents so that they outlive a power cut.

    Raises:
        OSError: it cannot be created.
    """
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync_folder(folder.parent)


def sync_folder(path: Path) -> None:
    """Flush a folder's list of names to the disk: without it a rename may be lost although the file is safe.

    Raises:
        OSError: the folder cannot be opened or flushed.
    """
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def try_writing(folder: Path) -> None:
    """Create and remove a small file, to learn now rather than after hours whether the folder takes files.

    Raises:
        StoreError: it does not.
    """
    with storage_errors(f"write in {folder}"):
        make_folder(folder)
        probe = temporary_beside(folder / "probe")
        try:
            with probe.open("xb") as file:
                file.write(bytes(4096))
                file.flush()
                os.fsync(file.fileno())
        finally:
            probe.unlink(missing_ok=True)


def claim_version(folder: Path, stage: str) -> int:
    """Take the next version number of a stage, for ever: also after `rm`, and never twice between processes.

    Args:
        folder: `ROOT/NAME`, created where needed.
        stage: which stage.

    Raises:
        StoreError: the folder cannot be written.
    """
    claims = folder / ".claims"
    with storage_errors(f"write in {folder}"):
        make_folder(claims)
        taken = [*claims.glob(f"{stage}-v*"), *folder.glob(f"{stage}-v*")]
        version = 1 + max(map(_version, taken), default=0)
        while not _create(claims / f"{stage}-v{version}"):
            version += 1
        sync_folder(claims)
    return version


def keep_claim(folder: Path, stem: str) -> bool:
    """See to it that `STAGE-vN` stays taken, also where the artifact came without its claim; False where it was.

    Raises:
        OSError: the folder cannot be written.
    """
    claims = folder / ".claims"
    make_folder(claims)
    created = _create(claims / stem)
    sync_folder(claims)
    return created


def _create(path: Path) -> bool:
    """Create an empty file; False when it is already there."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _version(path: Path) -> int:
    digits = path.stem.rpartition("-v")[2]
    return int(digits) if digits.isascii() and digits.isdigit() else 0
