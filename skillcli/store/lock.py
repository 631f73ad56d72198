"""One lock per store: a symbolic link `.lock` without a file behind it, whose target names the owner.

A link appears together with its text, and only if there is none: no lock is ever without an owner, even after a kill. It
takes no block of the disk, so a store on a full disk can still be locked to remove something. Where links cannot be made,
the lock is a file with the same text. Advisory locks of the system are missing on many network file systems.

The lock is held only while names appear or vanish, never during computation. A process that dies leaves its lock behind;
on the same machine this is detected at once, elsewhere after `ABANDONED_SECONDS` without a change. Version numbers do not
depend on the lock: they are claimed by exclusive creation.
"""

from __future__ import annotations

import errno
import fcntl
import os
import random
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from skillcli.errors import StoreError
from skillcli.store.atomic import NO_LINKS, make_folder, storage_errors
from skillcli.store.process import boot_tag, booted, host_tag, is_running, machine_tag, started

LOCK = ".lock"
PATIENCE_SECONDS = 10.0  # how long a user waits
ABANDONED_SECONDS = 120.0  # longer than any process holds the lock, by a factor of ten

_LONGEST = 59  # bytes: ext4 stores a target of this length in the inode, most other file systems a longer one
_OWNER = re.compile(
    r"skill:(?P<token>[0-9a-f]{6}):(?P<host>[0-9a-f]{6}|):(?P<boot>[0-9a-f]{4}):(?P<machine>[0-9a-f]{8}):"
    r"(?P<pid>[1-9a-f][0-9a-f]{0,7}):(?P<started>[0-9a-f]{0,16}):(?P<name>[A-Za-z0-9._-]*)",
    re.ASCII,
)
_given_up: set[str] = set()  # locks of this process that could not be removed


@dataclass(frozen=True)
class Owner:
    """The process that holds a lock."""

    host: str  # tag of the machine, "" if it has none
    boot: str  # tag of its last start
    machine: str  # tag of both, and of the process number space: containers have their own
    pid: int
    started: str  # kernel clock ticks, hexadecimal; "" if unknown
    name: str  # beginning of the machine's name
    since: float  # seconds since 1970, by the clock of the file system

    def __str__(self) -> str:
        """Describe the owner in messages."""
        age = max(0.0, time.time() - self.since)
        return f"process {self.pid} on {self.name or 'another machine'} since {age:.0f} s"

    @property
    def here(self) -> bool:
        """Return whether the owner is a process of this machine, whose end can be detected."""
        return self.machine == machine_tag()

    @property
    def gone(self) -> bool:
        """Return whether the process is known to have ended: it is not running here, or this machine has restarted."""
        if self.here:
            return not is_running(self.pid, str(int(self.started, 16)) if self.started else "")
        return bool(self.host) and self.host == host_tag() and self.boot != boot_tag() and self.since < booted()


class _Seen(NamedTuple):
    """A lock as it was found."""

    text: str
    owner: Owner | None  # None: not legible


@contextmanager
def locked(root: Path, *, take_over: bool = False, patience: float | None = None) -> Iterator[Callable[[], None]]:
    """Hold the lock of the store at `root`.

    Args:
        root: the store's folder, created if needed.
        take_over: for work that must not be lost: after `ABANDONED_SECONDS` of the same owner, take the lock from it.
        patience: seconds to wait for one owner otherwise; None for `PATIENCE_SECONDS`.

    Yields:
        A function that raises a StoreError once another process has taken over the lock.

    Raises:
        StoreError: another process keeps the lock, the file is not a lock, or the folder cannot be written.
    """
    path = root / LOCK
    with storage_errors(f"lock {root}"):
        make_folder(root)
        waiting = PATIENCE_SECONDS if patience is None else patience
        text = _acquire(path, take_over, ABANDONED_SECONDS if take_over else waiting)

    def check() -> None:
        with storage_errors(f"look at {path}"):
            if _text(path) != text:
                raise StoreError(f"the lock of {root} was taken over meanwhile", "the disk is slow: run it again")

    try:
        yield check
    finally:
        try:
            if _text(path) == text:
                path.unlink()
        except (OSError, StoreError):  # the work under the lock is done; the next process finds it abandoned
            _given_up.add(text)


def unlock(root: Path, *, force: bool = False) -> Owner | None:
    """Remove a lock that was left behind, and return its owner.

    Raises:
        StoreError: its owner still runs here, and `force` is not given; or the file is not a lock.
    """
    path = root / LOCK
    with storage_errors(f"unlock {root}"):
        seen = _look(path)
        if seen is None:
            return None
        owner = seen.owner
        if owner and owner.here and not owner.gone and not force:
            raise StoreError(f"{root} is locked by {owner}, which is still running", "wait for it, or give --force")
        _break(path, seen.text)
    return owner


def _acquire(path: Path, take_over: bool, patience: float) -> str:
    """Create the lock, waiting for others; return its text."""
    text = _mine()
    before, since = "", time.monotonic()
    while not _create(path, text):
        seen = _look(path)
        if seen is None:
            continue
        if seen.text != before:
            before, since = seen.text, time.monotonic()
        waited = time.monotonic() - since
        if (seen.owner and seen.owner.gone) or seen.text in _given_up or (waited > patience and take_over):
            _break(path, seen.text)
        elif waited > patience:
            hint = "wait for it; `skill unlock` removes the lock of a process that has ended"
            raise StoreError(f"{path.parent} is locked by {seen.owner or 'an unknown process'}", hint)
        else:
            time.sleep(random.uniform(0.001, 0.02))
    return text


def _mine() -> str:
    pid = os.getpid()
    ticks = started(pid)
    fields = [secrets.token_hex(3), host_tag(), boot_tag(), machine_tag(), f"{pid:x}", f"{int(ticks):x}" if ticks else ""]
    name = re.sub(r"[^A-Za-z0-9._-]", "", os.uname().nodename)
    return f"skill:{':'.join(fields)}:{name}"[:_LONGEST]


def _create(path: Path, text: str) -> bool:
    """Create the lock; return False if there is one."""
    try:
        os.symlink(text, path)  # noqa: PTH211 - the text is not a path
    except FileExistsError:
        return False
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        return _create_file(path, text)
    return True


def _create_file(path: Path, text: str) -> bool:
    try:
        handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
    except FileExistsError:
        return False
    try:
        os.write(handle, text.encode())
    except OSError:
        path.unlink()  # a full disk must not leave a lock without an owner
        raise
    finally:
        os.close(handle)
    return True


def _look(path: Path) -> _Seen | None:
    """Return the present lock, or None.

    Raises:
        StoreError: the file is not a lock, so it must neither be waited for nor removed.
        OSError: it cannot be read.
    """
    try:
        since = path.lstat().st_mtime
    except FileNotFoundError:
        return None
    text = _text(path)
    if text is None:  # it has vanished
        return None
    found = _OWNER.fullmatch(text)
    if not found:
        return _Seen(text, None)
    own = {key: found[key] for key in ("host", "boot", "machine", "started", "name")}
    return _Seen(text, Owner(pid=int(found["pid"], 16), since=since, **own))


def _text(path: Path) -> str | None:
    """Return the text of a lock; None without one.

    Raises:
        StoreError: the file is not a lock.
        OSError: it cannot be read.
    """
    try:
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            return _read(path)
        text = os.readlink(path) if stat.S_ISLNK(mode) else ""  # noqa: PTH115 - not a path
    except FileNotFoundError:
        return None
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.ELOOP):  # the lock changed its kind meanwhile
            return None
        raise
    if not _OWNER.fullmatch(text):
        found = f"a link to {text!r}" if text else "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
        raise StoreError(f"expected a lock of skill at {path}, found {found}", "move it away")
    return text


def _read(path: Path) -> str:
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        return os.read(handle, 1 << 12).decode("ascii", "replace")
    finally:
        os.close(handle)


def _break(path: Path, text: str) -> None:
    """Remove the lock with this text, never one that was taken since.

    Processes that break locks exclude each other by a system lock on the folder: whoever holds it and still finds the same
    text may remove it.
    """
    handle = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        with suppress(OSError):  # missing on some network file systems: there the moment between the two lines is unguarded
            fcntl.flock(handle, fcntl.LOCK_EX)
        if _text(path) == text:
            path.unlink(missing_ok=True)
    finally:
        os.close(handle)
