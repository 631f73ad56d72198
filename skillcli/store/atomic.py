"""Write files that are either complete under their final name or absent, even after a crash or a power cut."""

from __future__ import annotations

import errno
import itertools
import os
import re
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TypeVar

from skillcli.errors import StoreError
from skillcli.store.ids import LAST_VERSION, file_pattern
from skillcli.store.process import is_running, machine_tag

T = TypeVar("T")

TEMPORARY = ".tmp-"
"""Prefix of unfinished files: `.tmp-WHAT-MACHINE-PID-RANDOM`; they remain if a process is killed."""

CLAIMS = ".claims"
"""Folder below each name: an empty file for every version number ever given."""

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk."""

LEFT_OVER_SECONDS = 24 * 3600.0
"""An unfinished file that did not change for so long is left over, whatever became of its process."""

NO_LINKS = (errno.EPERM, errno.ENOSYS, errno.EOPNOTSUPP)
"""Error numbers of a file system without links: FAT, and some network file systems."""

_HINTS = {
    errno.ENOSPC: "the disk is full: free some space, or choose another folder with --store",
    errno.EDQUOT: "the disk quota is used up: free some space, or choose another folder with --store",
    errno.EFBIG: "the file is larger than is allowed here: see `ulimit -f`, or choose another folder with --store",
    errno.EROFS: "the file system is read-only: choose another folder with --store",
    errno.EACCES: "you may not write here: choose another folder with --store",
    errno.EPERM: "you may not write here: choose another folder with --store",
    errno.EIO: "the disk, or the connection to it, fails: check it, then `skill verify --all`",
    errno.ENOTDIR: "a file lies where a folder is needed: move it away, or choose another folder with --store",
    errno.EEXIST: "a file lies where a folder or a new artifact is needed: move it away",
}

_OURS = re.compile(rf"{re.escape(TEMPORARY)}.*-[0-9a-f]{{8}}-[1-9][0-9]*-[0-9a-f]{{8}}(\.[a-z0-9]+)?", re.ASCII)


@contextmanager
def storage_errors(action: str) -> Iterator[None]:
    """Turn an error of the operating system during `action` into a StoreError with advice."""
    try:
        yield
    except OSError as error:
        hint = _HINTS.get(error.errno or 0, "check the disk and the folder's permissions")
        raise StoreError(f"cannot {action}: {error.strerror or error}", hint) from error


def is_disk_failure(error: StoreError) -> bool:
    """Return whether a file could not be read because the disk failed, so that its content is unknown."""
    cause = error.__cause__
    known = isinstance(cause, OSError) and cause.errno is not None  # HDF5 raises one without a number for damaged files
    return known and not isinstance(cause, FileNotFoundError | PermissionError)


def write_atomically(
    path: Path,
    data: memoryview,
    check: Callable[[Path], T],
    *,
    replace: bool = False,
    naming: AbstractContextManager[object] | None = None,
) -> T:
    """Write `data` beside `path`, flush it to the disk, check the written file, and only then rename it.

    Args:
        path: the final name; its folder exists.
        data: the bytes of the file.
        check: reads the finished temporary file; raises to refuse it.
        replace: whether an existing file may be replaced.
        naming: context entered while the file gets its name; may raise to refuse it.

    Returns:
        What `check` returned.

    Raises:
        StoreError: the disk refused. `path` is as it was before, unless only flushing the folder failed: then the whole
            file is there, and may be lost in a power cut.
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
    """Return a name for an unfinished file, which identifies its process."""
    return path.with_name(
        f"{TEMPORARY}{path.stem.lstrip('.')}-{machine_tag()}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}"
    )


def is_left_over(path: Path) -> bool:
    """Return whether an unfinished file is abandoned: its process has ended, or it has not changed for a day."""
    if _has_ended(path):
        return True
    try:
        return time.time() - path.lstat().st_mtime > LEFT_OVER_SECONDS
    except OSError:  # finished or removed meanwhile
        return False


def _has_ended(path: Path) -> bool:
    """Return whether the process named in an unfinished file's name is known to have ended."""
    tag, pid, _ = ["", "", *path.stem.split("-")][-3:]
    return tag == machine_tag() and pid.isascii() and pid.isdigit() and not is_running(int(pid))


def sweep(folder: Path) -> None:
    """Remove unfinished files of killed processes of this machine from a folder outside a store.

    Raises:
        OSError: the folder cannot be listed, or the disk refuses.
    """
    for entry in list(os.scandir(folder)):
        path = folder / entry.name
        if _OURS.fullmatch(entry.name) and entry.is_file(follow_symlinks=False) and _has_ended(path):
            path.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Create a folder and its parents so that they survive a power cut.

    Raises:
        OSError: it cannot be created.
    """
    missing = list(itertools.takewhile(lambda folder: not folder.exists(), (path, *path.parents)))
    if missing or not path.is_dir():
        path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync_folder(folder.parent)


def sync_folder(path: Path) -> None:
    """Flush the names in a folder to the disk: otherwise a rename may be lost although the file is safe.

    Raises:
        OSError: the folder cannot be opened or flushed.
    """
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def try_writing(folder: Path) -> None:
    """Create and remove a small file, to learn now and not after hours whether the folder can be written.

    Raises:
        StoreError: it cannot.
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
    """Take the next version number of a stage for ever: it is not given again after `rm`, nor to another process.

    Args:
        folder: `ROOT/NAME`, created if needed.
        stage: which stage.

    Raises:
        StoreError: the folder cannot be written, or all numbers are taken.
    """
    claims = folder / CLAIMS
    with storage_errors(f"write in {folder}"):
        make_folder(claims)
        version = next_version(folder, stage)
        while not _create(claims / f"{stage}-v{version}"):
            version += 1
        sync_folder(claims)
    return version


def next_version(folder: Path, stage: str) -> int:
    """Return the version number that a stage would get now.

    Raises:
        StoreError: all are taken.
        OSError: the folder cannot be listed.
    """
    claimed = file_pattern(after=r"(\.h5)?")
    taken = [found for place in (folder, folder / CLAIMS) for name in _names(place) if (found := claimed.fullmatch(name))]
    version = 1 + max((int(found["version"]) for found in taken if found["stage"] == stage), default=0)
    if version > LAST_VERSION:
        raise StoreError(f"{folder.name}/{stage} has had its last version, {LAST_VERSION}", "give --name another name")
    return version


def keep_claim(folder: Path, stem: str) -> bool:
    """Claim `STAGE-vN`, for an artifact that came without its claim; return False if it was claimed.

    Raises:
        OSError: the folder cannot be written.
    """
    claims = folder / CLAIMS
    make_folder(claims)
    created = _create(claims / stem)
    if created:
        sync_folder(claims)
    return created


def claim_for(folder: Path, stem: str, content_sha256: str) -> bool:
    """Claim `STAGE-vN` for this content; return False if something else has or had it.

    Raises:
        OSError: the folder cannot be written.
    """
    claims = folder / CLAIMS
    make_folder(claims)
    text = content_sha256.encode()
    return create_whole(claims / stem, text, folder) or (claims / stem).read_bytes() == text


def create_whole(path: Path, data: bytes, beside: Path | None = None) -> bool:
    """Create a file that has its whole content from the first moment; return False if there is one.

    Args:
        path: the file.
        data: its content.
        beside: folder for the unfinished file, by default that of `path`.

    Raises:
        OSError: the disk refuses.
    """
    temporary = temporary_beside((beside or path.parent) / path.name)
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        try:
            os.link(temporary, path)
        except FileExistsError:
            return False
        except OSError as error:
            if error.errno not in NO_LINKS:
                raise
            if not _create(path):
                return False
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    sync_folder(path.parent)
    return True


def remove_claimed(path: Path) -> None:
    """Remove an artifact's file but keep its number taken; on a full disk the file itself becomes the claim.

    Raises:
        OSError: the disk refuses.
    """
    try:
        keep_claim(path.parent, path.stem)
        path.unlink()
    except OSError as error:
        claim = path.parent / CLAIMS / path.stem
        if error.errno not in FULL or not claim.parent.exists():
            raise
        path.rename(claim)
        os.truncate(claim, 0)
        sync_folder(claim.parent)
    sync_folder(path.parent)


def _create(path: Path) -> bool:
    """Create an empty file; return False if it exists."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()] if folder.exists() else []
