"""Which process wrote something, and whether it still runs: a process is known by machine, number and start."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from functools import cache
from pathlib import Path


@cache
def machine() -> str:
    """This host, since its last start, in its own space of process numbers (a container has its own)."""
    parts = [os.uname().nodename, "", ""]
    with suppress(OSError):
        parts[1] = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    with suppress(OSError):
        parts[2] = str(Path("/proc/self/ns/pid").readlink())
    return " ".join(parts)


def machine_tag() -> str:
    """The machine as eight hexadecimal digits, for the names of files."""
    return hashlib.sha256(machine().encode()).hexdigest()[:8]


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


def _stat(pid: int) -> list[str]:
    """State, parent and so on of a process, as proc(5) lists them behind the name."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
