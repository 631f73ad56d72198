"""Messages between the driver `simulation` and its arm: a length, a kind, then JSON or plain numbers. Nothing is pickled."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from skillcli.trajectories import Array

_HEAD = struct.Struct("<IB")  # bytes that follow the head, kind
LARGEST = 1 << 22  # bytes of one message: a recipe with a thousand goals is smaller
POSE = 7  # numbers of an object's pose


class Kind(IntEnum):
    """What a message is."""

    SETUP = 1  # to the arm, JSON: recipe, robot, speed, faults
    RESET = 2  # to the arm, JSON: parameters of the robot, seed of its sensors
    COMMAND = 3  # to the arm, numbers: which command, target
    HOLD = 4  # to the arm, nothing
    READY = 5  # from the arm, JSON: names of the joints
    NAMES = 6  # from the arm, JSON: other names from now on
    READING = 7  # from the arm, numbers: see `Reading`
    TROUBLE = 8  # from the arm, JSON: why it ends


class Reading(NamedTuple):
    """What the arm measures."""

    stamp: float  # s, on the clock of `time.monotonic`
    taken: int  # number of the last command that the arm took, 0 for none
    position: Array  # (J,) rad
    velocity: Array  # (J,) rad/s
    pose: Array | None  # (7,) m and w x y z, of the object


def packed(kind: Kind, body: bytes = b"") -> bytes:
    """Return the bytes of a message."""
    return _HEAD.pack(len(body), kind) + body


def packed_json(kind: Kind, content: Any) -> bytes:
    """Return the bytes of a message in JSON."""
    return packed(kind, json.dumps(content).encode())


def packed_command(number: int, target: Array) -> bytes:
    """Return the bytes of a command: its number, and the target (J,) rad."""
    return packed(Kind.COMMAND, np.array([number, *target], dtype="<f8").tobytes())


def read_command(body: bytes) -> tuple[int, Array]:
    """Return number and target of a command."""
    numbers = np.frombuffer(body, dtype="<f8")
    return int(numbers[0]), numbers[1:].copy()


def packed_reading(reading: Reading) -> bytes:
    """Return the bytes of a reading; without an object its pose is left out."""
    pose = () if reading.pose is None else reading.pose
    numbers = np.array([reading.stamp, reading.taken, *reading.position, *reading.velocity, *pose], dtype="<f8")
    return packed(Kind.READING, numbers.tobytes())


def read_reading(body: bytes, joints: int) -> Reading:
    """Return a reading of an arm with this many joints."""
    numbers = np.frombuffer(body, dtype="<f8").copy()
    position, velocity, pose = np.split(numbers[2:], [joints, 2 * joints])
    return Reading(float(numbers[0]), int(numbers[1]), position, velocity, pose if len(pose) == POSE else None)


class Inbox:
    """Cuts the bytes that a socket delivers into messages."""

    def __init__(self, end: socket.socket) -> None:
        self._end, self._bytes = end, bytearray()

    def take(self) -> Iterator[tuple[Kind, bytes]]:
        """Yield the messages that are there, without waiting.

        Raises:
            ConnectionError: the other end is closed, or sends what is no message.
        """
        closed = False
        while True:
            try:
                part = self._end.recv(1 << 16)
            except (BlockingIOError, InterruptedError):
                break
            closed = not part
            self._bytes += part
            if closed:
                break
        yield from self._whole()
        if closed:
            raise ConnectionError("closed by the other end")

    def _whole(self) -> Iterator[tuple[Kind, bytes]]:
        while len(self._bytes) >= _HEAD.size:
            size, kind = _HEAD.unpack_from(self._bytes)
            if size > LARGEST or kind not in Kind.__members__.values():
                raise ConnectionError(f"a message of kind {kind} and {size} bytes")
            if len(self._bytes) < _HEAD.size + size:
                return
            body = bytes(self._bytes[_HEAD.size : _HEAD.size + size])
            del self._bytes[: _HEAD.size + size]
            yield Kind(kind), body


class Outbox:
    """Sends whole messages without ever waiting: what does not fit while nobody reads is left out."""

    def __init__(self, end: socket.socket) -> None:
        self._end, self._bytes = end, bytearray()

    def send(self, message: bytes, must: bool = False) -> None:
        """Send a message now, or not at all; one that must arrive is kept until there is room.

        Raises:
            ConnectionError: the other end is closed.
        """
        self.flush()
        if must or not self._bytes:
            self._bytes += message
            self.flush()

    def flush(self) -> None:
        """Send what is left of earlier messages.

        Raises:
            ConnectionError: the other end is closed.
        """
        while self._bytes:
            try:
                sent = self._end.send(self._bytes)
            except (BlockingIOError, InterruptedError):
                return
            del self._bytes[:sent]
