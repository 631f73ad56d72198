"""Identify the process that wrote a file, by machine, number and start, and tell whether it still runs."""

from __future__ import annotations

import hashlib
import math
import os
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

_BOOT_ID = "/proc/sys/kernel/random/boot_id"


@cache
def machine() -> str:
    """Identify this host since its last start, and its process number space (a container has its own)."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return f"{os.uname().nodename} {_text(_BOOT_ID)} {space}"


def machine_tag() -> str:
    """Return the machine as eight hexadecimal digits, for file names."""
    return _digits(machine(), 8)


def host_tag() -> str:
    """Return this host as six hexadecimal digits, independent of restarts; "" if it has no lasting identity."""
    identity = _text("/etc/machine-id")
    return _digits(f"{os.uname().nodename} {identity}", 6) if identity else ""


def boot_tag() -> str:
    """Return the last start of this machine as four hexadecimal digits."""
    return _digits(_text(_BOOT_ID), 4)


def booted() -> float:
    """Return when this machine last started, seconds since 1970 by its present clock; -inf if unknown."""
    try:
        return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)
    except (AttributeError, OSError):
        return -math.inf


def started(pid: int) -> str:
    """Return when a process of this machine started, in kernel clock ticks; "" if unknown."""
    fields = _stat(pid)
    return fields[19] if len(fields) > 19 else ""


def is_running(pid: int, since: str = "") -> bool:
    """Return whether a process of this machine runs; with `since`, whether it is the one that started then."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # of another user
        pass
    if _stat(pid)[:1] in (["Z"], ["X"]):  # ended, but its parent has not waited for it
        return False
    return not since or started(pid) in (since, "")


def _text(path: str) -> str:
    """Read a short system file; "" if there is none."""
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def _digits(text: str, count: int) -> str:
    return hashlib.sha256(text.encode(errors="replace")).hexdigest()[:count]


def _stat(pid: int) -> list[str]:
    """Return state, parent and so on of a process, the fields after its name in proc(5)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
