"""One lock per store, a file of our own: advisory locks of the system are missing on many network file systems.

It is held for the moments in which names appear or vanish, never while anything is computed. Whoever dies inside leaves
it behind; on the same machine that is seen and put right at once, elsewhere after `ABANDONED_SECONDS` without a change.
Version numbers do not depend on it: they are taken by exclusive creation.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import random
import secrets
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from skillcli.errors import StoreError
from skillcli.store.atomic import make_folder, storage_errors
from skillcli.store.process import is_running, machine, started

LOCK = ".lock"
PATIENCE_SECONDS = 10.0  # of a person who removes or imports something
ABANDONED_SECONDS = 120.0  # nobody holds the lock a tenth as long

_UNKNOWN = "an unknown process"


@dataclass(frozen=True)
class Owner:
    """Who holds a lock, as it is written into the file."""

    token: str
    host: str
    machine: str
    pid: int
    started: str
    command: str
    since: float  # seconds since 1970, the owner's clock

    def __str__(self) -> str:
        """As it stands in messages."""
        age = max(0.0, time.time() - self.since)
        return f"process {self.pid} on {self.host} since {age:.0f} s ({self.command})"

    @property
    def gone(self) -> bool:
        """Whether the process is known to have ended, which only its own machine can tell."""
        return self.machine == machine() and not is_running(self.pid, self.started)


@contextmanager
def locked(root: Path, *, take_over: bool = False, patience: float | None = None) -> Iterator[None]:
    """Hold the lock of the store at `root`.

    Args:
        root: the store's folder, created where needed.
        take_over: for work that must not be lost: after `ABANDONED_SECONDS` of the same owner, take the lock from it.
        patience: seconds to wait for one owner otherwise; `PATIENCE_SECONDS` where none are given.

    Raises:
        StoreError: somebody else keeps it, or the folder cannot be written.
    """
    path = root / LOCK
    with storage_errors(f"lock {root}"):
        make_folder(root)
        waiting = PATIENCE_SECONDS if patience is None else patience
        token = _acquire(path, take_over, ABANDONED_SECONDS if take_over else waiting)
    try:
        yield
    finally:
        with suppress(OSError):  # what was done under the lock is done; a lock left behind is found to be stale
            if _token(path) == token:
                path.unlink()


def read_owner(path: Path) -> Owner | None:
    """The owner of a lock file; None where there is no lock, or nothing legible in it yet."""
    try:
        with path.open("rb") as file:
            owner = Owner(**json.loads(file.read(1 << 16)))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return owner if isinstance(owner.pid, int) and isinstance(owner.since, int | float) else None


def unlock(root: Path, *, force: bool = False) -> Owner | None:
    """Remove a lock that was left behind, and say whose it was.

    Raises:
        StoreError: its owner is still at work here, and `force` is not given.
    """
    path = root / LOCK
    owner = read_owner(path)
    if owner and owner.machine == machine() and not owner.gone and not force:
        raise StoreError(f"{root} is locked by {owner}, which is still running", "wait for it, or give --force")
    with storage_errors(f"unlock {root}"):
        _break(path, owner.token if owner else "")
    return owner


def _acquire(path: Path, take_over: bool, patience: float) -> str:
    """Create the lock file, waiting for others; returns the token in it."""
    mine = Owner(
        secrets.token_hex(8), os.uname().nodename, machine(), os.getpid(), started(os.getpid()),
        shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])[:200], time.time(),
    )  # fmt: skip
    seen, since = "", time.monotonic()
    while not _create(path, mine):
        owner = read_owner(path)
        token = owner.token if owner else ""
        if token != seen:
            seen, since = token, time.monotonic()
        waited = time.monotonic() - since
        if (owner and owner.gone) or (waited > patience and take_over):
            _break(path, token)
        elif waited > patience:
            hint = "wait for it; `skill unlock` removes the lock of a process that has ended"
            raise StoreError(f"{path.parent} is locked by {owner or _UNKNOWN}", hint)
        else:
            time.sleep(random.uniform(0.001, 0.02))
    return mine.token


def _create(path: Path, owner: Owner) -> bool:
    """Make the lock file with its owner in it; False when there is one."""
    try:
        handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
    except FileExistsError:
        return False
    try:
        os.write(handle, json.dumps(asdict(owner)).encode())
    except OSError:
        path.unlink()  # a full disk must not leave a lock that nobody owns
        raise
    finally:
        os.close(handle)
    return True


def _token(path: Path) -> str:
    owner = read_owner(path)
    return owner.token if owner else ""


def _break(path: Path, token: str) -> None:
    """Remove the lock with this token, never one that was taken since.

    Those who break locks exclude each other by a lock of the system on the file itself: whoever holds it and still finds
    the same file under the name may remove it.
    """
    try:
        file = path.open("r+b")
    except FileNotFoundError:
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
                raise
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()) and _token(path) == token:
                path.unlink()
