"""Do something dangerous in a forked child of little time and memory, and see how it ends."""

from __future__ import annotations

import json
import os
import resource
import signal
from collections.abc import Callable
from typing import Any, NamedTuple

SECONDS = 5
MEGABYTES = 500


class End(NamedTuple):
    """How a child ended: what it returned, as JSON knows it, or the name of the signal that ended it."""

    value: Any
    signal: str
    cpu: float
    megabytes: float  # more than the parent had


def forked(work: Callable[[], Any], seconds: int = SECONDS) -> End:
    """Run `work` in a child that may take `seconds` of CPU, and as many more of wall time before it is killed."""
    before = _resident()
    read, write = os.pipe()
    child = os.fork()
    if not child:
        _work(work, write, seconds)
    os.close(write)
    with os.fdopen(read) as pipe:
        text = pipe.read()
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    ended = signal.Signals(-code).name if code < 0 else ""
    return End(json.loads(text) if text else None, ended, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024 - before)


def _work(work: Callable[[], Any], write: int, seconds: int) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(4 * seconds)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what a library says of itself while it dies
    try:
        text = json.dumps(work())
    except BaseException as error:
        text = json.dumps({"raised": f"{type(error).__name__}: {error}"})
    os.write(write, text.encode()[:60_000])
    os._exit(0)


def _resident() -> float:
    with open("/proc/self/status") as status:  # noqa: PTH123 - a file of the kernel
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024
