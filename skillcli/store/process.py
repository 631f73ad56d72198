"""Which process wrote something, and whether it still runs: a process is known by machine, number and start."""

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
    """This host, since its last start, in its own space of process numbers (a container has its own)."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return f"{os.uname().nodename} {_text(_BOOT_ID)} {space}"


def machine_tag() -> str:
    """The machine as eight hexadecimal digits, for the names of files."""
    return _digits(machine(), 8)


def host_tag() -> str:
    """This host, whatever its starts, as six hexadecimal digits; "" where it has no identity that outlives them."""
    identity = _text("/etc/machine-id")
    return _digits(f"{os.uname().nodename} {identity}", 6) if identity else ""


def boot_tag() -> str:
    """The last start of this machine as four hexadecimal digits."""
    return _digits(_text(_BOOT_ID), 4)


def booted() -> float:
    """When this machine last started, seconds since 1970 by its present clock; -inf where that cannot be known."""
    try:
        return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)
    except (AttributeError, OSError):
        return -math.inf


def started(pid: int) -> str:
    """When a process of this machine started, in the kernel's clock ticks; "" where that cannot be known."""
    fields = _stat(pid)
    return fields[19] if len(fields) > 19 else ""


def is_running(pid: int, since: str = "") -> bool:
    """Whether a process of this machine runs; with `since`, whether it is the one that started then."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        pass
    if _stat(pid)[:1] in (["Z"], ["X"]):  # ended, only its parent has not looked yet
        return False
    return not since or started(pid) in (since, "")


def _text(path: str) -> str:
    """A short file of the system's; "" where there is none."""
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def _digits(text: str, count: int) -> str:
    return hashlib.sha256(text.encode(errors="replace")).hexdigest()[:count]


def _stat(pid: int) -> list[str]:
    """State, parent and so on of a process, as proc(5) lists them behind the name."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
