"""The process in which libhdf5 parses files from elsewhere: a crash ends this process only.

It is started as `python -m skillcli.store.quarantine_child CHANNEL`, imports h5py once and forks a fresh process for every
file, so that no file can affect the next. `skillcli.store.quarantine` is the other side and describes the messages.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import sys
from typing import Any, BinaryIO, NoReturn

import h5py
import numpy as np

from skillcli.store.hdf5_reader import FAULTS, Listing, first_line, list_contents, read_array
from skillcli.store.quarantine import ADDRESS_BYTES, CPU_SECONDS, FINE, INTEGER, REFUSED, WALL_SECONDS


def serve(channel: socket.socket) -> None:
    """Fork a reader for every request until the channel closes, and report how each one ended.

    A request is one byte with three descriptors: the file, the pipe for the answer, and the pipe that tells it to continue.
    """
    while True:
        request, handles, _, _ = socket.recv_fds(channel, 1, 3)
        if not request:
            return
        reader = os.fork()
        if reader == 0:
            channel.close()
            _read_and_exit(*handles)
        for handle in handles:
            os.close(handle)
        channel.sendall(INTEGER.pack(os.waitstatus_to_exitcode(os.waitpid(reader, 0)[1])))


def _read_and_exit(file: int, answer: int, go_on: int) -> NoReturn:
    try:
        _limit()
        with os.fdopen(file, "rb", buffering=0) as source, os.fdopen(answer, "wb") as sink, os.fdopen(go_on, "rb") as control:
            _answer(source, sink, control)
    finally:
        os._exit(0)


def _limit() -> None:
    """Limit the resources for one file; the system ends the process beyond them."""
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_BYTES, ADDRESS_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(WALL_SECONDS)


def _answer(source: BinaryIO, sink: BinaryIO, control: BinaryIO) -> None:
    """Describe the file; when told to continue, send every array, each after a byte that says whether it could be read."""
    try:
        file = h5py.File(source, "r")
        listing = list_contents(file, os.fstat(source.fileno()).st_size)
    except FAULTS as error:
        _send(sink, REFUSED, first_line(error).encode("utf-8", "replace"))
        return
    _send(sink, FINE, json.dumps(_described(listing)).encode())
    sink.flush()
    if not control.read(1):
        return
    for dataset in listing.datasets.values():
        try:
            array = read_array(dataset)
        except FAULTS as error:
            _send(sink, REFUSED, first_line(error).encode("utf-8", "replace"))
            return
        sink.write(FINE)
        sink.write(array.reshape(-1).view(np.uint8).data)  # no copy: reading made it contiguous


def _described(listing: Listing) -> dict[str, Any]:
    return {
        "userblock": listing.userblock,
        "attributes": listing.attributes,
        "labels": listing.labels,
        "arrays": [[path, dataset.dtype.str, list(dataset.shape)] for path, dataset in listing.datasets.items()],
    }


def _send(sink: BinaryIO, verdict: bytes, text: bytes) -> None:
    sink.write(verdict + INTEGER.pack(len(text)) + text)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C; a closed channel ends this process
    with socket.socket(fileno=int(sys.argv[1])) as parent:
        parent.sendall(FINE)
        serve(parent)
