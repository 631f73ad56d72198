"""Read files from elsewhere in a separate process, with bounded memory, CPU and time.

libhdf5 can crash on damaged metadata: a B-tree that is its own child ends in signal 11. So `quarantine_child` parses any
file that was not written here, and only plain bytes come back: a description as JSON, and the raw numbers of every array.
If the process dies, the file is refused.
"""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from skillcli.errors import StoreError
from skillcli.store.hdf5_safety import DTYPES, MAX_OBJECTS, PATH

Array = NDArray[Any]

MAX_DATA_BYTES = 96 << 20
"""Limit for all arrays of a file from elsewhere. With three copies of them, a command stays below half a gigabyte."""

MAX_FILE_BYTES = 128 << 20  # of a file from elsewhere
_MAX_TEXT = 4 << 20  # of the description

CPU_SECONDS = 3
WALL_SECONDS = 20
ADDRESS_BYTES = 400 << 20  # h5py takes a quarter of it, the largest allowed array another

INTEGER = struct.Struct("<q")
FINE, REFUSED = b"\0", b"\1"

_DEATHS = {
    signal.SIGXCPU: f"took more than {CPU_SECONDS} s of CPU",
    signal.SIGKILL: f"took more than {CPU_SECONDS} s of CPU, or was killed",
    signal.SIGALRM: f"took more than {WALL_SECONDS} s",
}


class Description:
    """The checked description of a file's content, as the child sends it.

    Raises:
        ValueError: it has another form, or exceeds a limit.
    """

    def __init__(self, told: Any) -> None:
        self.userblock = int(told["userblock"])
        self.attributes: dict[str, str | int] = told["attributes"]
        self.labels = {path: (str(dimensions), str(unit)) for path, (dimensions, unit) in told["labels"].items()}
        self.arrays = [(str(path), np.dtype(kind), tuple(map(int, shape))) for path, kind, shape in told["arrays"]]
        total = sum(math.prod(shape) * kind.itemsize for _, kind, shape in self.arrays)
        if total > MAX_DATA_BYTES:
            raise ValueError(f"it holds {total} bytes of data, at most {MAX_DATA_BYTES} are read from elsewhere")
        known = all(
            PATH.fullmatch(path) and kind.str in DTYPES and min(shape, default=0) >= 0 for path, kind, shape in self.arrays
        )
        if len(self.arrays) > MAX_OBJECTS or not known:
            raise ValueError("its arrays are not described as the store does")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of every array by path."""
        return {path: shape for path, _, shape in self.arrays}


def read_elsewhere(file: BinaryIO, check: Callable[[Description], None]) -> tuple[Description, dict[str, Array]]:
    """Read a file that was not written here.

    Args:
        file: open, unbuffered; its position may change.
        check: called with the description before any data is read; may raise.

    Raises:
        ValueError: the file is refused, or crashed the process that read it.
        StoreError: no such process could be started.
    """
    with _LOCK:
        try:
            with _asked(file) as (answer, go_on):
                return _receive(answer, go_on, check)
        except EOFError:
            raise ValueError(f"reading it {_death(_CHILD.last_exit)}") from None


@contextmanager
def _asked(file: BinaryIO) -> Iterator[tuple[BinaryIO, int]]:
    """Hand a file to the child; yield the pipe of its answer, and the descriptor that tells it to continue."""
    with ExitStack() as ours:
        with ExitStack() as theirs:
            answer, answer_end = os.pipe()
            control, go_on = os.pipe()
            theirs.callback(os.close, answer_end)
            theirs.callback(os.close, control)
            ours.callback(os.close, go_on)
            reading = ours.enter_context(os.fdopen(answer, "rb"))
            _CHILD.request([file.fileno(), answer_end, control])
        asked = ExitStack()
        asked.callback(_CHILD.wait)
        asked.push(ours.pop_all())  # closed first: without permission to continue, the process ends
        with asked:
            yield reading, go_on


def _receive(answer: BinaryIO, go_on: int, check: Callable[[Description], None]) -> tuple[Description, dict[str, Array]]:
    _expect_fine(answer)
    described = Description(json.loads(_text(answer)))
    check(described)
    with suppress(BrokenPipeError):  # it has ended: the next read fails
        os.write(go_on, FINE)
    arrays = {}
    for path, kind, shape in described.arrays:
        _expect_fine(answer)
        data = np.empty(math.prod(shape) * kind.itemsize, np.uint8)
        _fill(answer, data)
        arrays[path] = data.view(kind).reshape(shape)
    return described, arrays


def _expect_fine(answer: BinaryIO) -> None:
    if _exactly(answer, 1) != FINE:
        text = _text(answer).decode("utf-8", "replace")
        raise ValueError("".join(mark if mark.isprintable() else "?" for mark in text)[:300])


def _text(answer: BinaryIO) -> bytes:
    (length,) = INTEGER.unpack(_exactly(answer, INTEGER.size))
    if not 0 <= length <= _MAX_TEXT:
        raise ValueError("its description is too long")
    return _exactly(answer, length)


def _exactly(answer: BinaryIO, length: int) -> bytes:
    data = answer.read(length)
    if len(data) != length:
        raise EOFError
    return data


def _fill(answer: BinaryIO, data: Array) -> None:
    view = data.data
    while view:
        count = answer.readinto(view)  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        view = view[count:]


def _death(exit_code: int) -> str:
    for number, words in _DEATHS.items():
        if exit_code == -number:
            return words
    return f"ended in signal {-exit_code} of the process that did" if exit_code < 0 else "ended early"


class _Child:
    """The process that forks a reader for every file: started when first needed, and again if it has ended."""

    def __init__(self) -> None:
        self.last_exit = 0  # of the last reader, as in `subprocess`
        self._channel: socket.socket | None = None
        self._owner = 0  # the process that started it: a forked process needs its own

    def request(self, handles: Sequence[int]) -> None:
        """Send the three descriptors of one request.

        Raises:
            StoreError: no process can be started.
        """
        for _ in range(2):
            if self._channel is None or self._owner != os.getpid():
                self._channel, self._owner = _start(), os.getpid()
            try:
                socket.send_fds(self._channel, [FINE], list(handles))
                return
            except OSError:
                self.close()
        raise StoreError("the process that reads files from elsewhere keeps ending", "check the limits of memory and processes")

    def wait(self) -> None:
        """Record how the reader ended."""
        try:
            assert self._channel is not None
            self.last_exit = INTEGER.unpack(self._channel.recv(INTEGER.size, socket.MSG_WAITALL))[0]
        except (OSError, struct.error):
            self.last_exit = -signal.SIGKILL
            self.close()

    def close(self) -> None:
        """Close the channel, which ends the process."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None


def _start() -> socket.socket:
    ours, theirs = socket.socketpair()
    environment = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",  # threads cost address space, and a fork has none
        "OMP_NUM_THREADS": "1",
        "HDF5_PLUGIN_PRELOAD": "::",  # load no filter plugins
    }
    command = [sys.executable, "-P", "-m", "skillcli.store.quarantine_child", str(theirs.fileno())]
    with theirs:
        try:
            process = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], env=environment,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except OSError as error:
            ours.close()
            raise StoreError(f"cannot start the process that reads files from elsewhere: {error.strerror}") from error
    process.returncode = 0  # it ends with the channel, and is never waited for
    if ours.recv(1) != FINE:
        ours.close()
        raise StoreError(
            "the process that reads files from elsewhere does not start", "it takes 200 MB of address space: see `ulimit -v`"
        )
    return ours


_CHILD = _Child()
_LOCK = threading.Lock()
