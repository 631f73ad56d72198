"""What every driver of an arm can do, simulated or real."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from skillcli.errors import SkillError
from skillcli.trajectories import Array


class DriverError(SkillError):
    """A driver cannot connect, or the arm no longer answers."""


@dataclass(frozen=True)
class JointState:
    """What an arm's encoders say at one moment."""

    names: tuple[str, ...]  # of the joints, in the order of the numbers
    position: Array  # (J,) rad
    velocity: Array  # (J,) rad/s
    stamp: float  # s, when it was measured, on the clock of `time.monotonic`


@dataclass(frozen=True)
class ObjectPose:
    """Where an object is at one moment, as a camera sees it."""

    pose: Array  # (7,) m and w x y z, in the frame of the arm's base
    stamp: float  # s, when it was measured, on the clock of `time.monotonic`


class Driver(Protocol):
    """One arm. Targets are commanded joint angles, in the order of `JointState.names`; the arm's own servos follow them.

    Every call returns at once or within a few milliseconds: who calls keeps the time. A driver checks nothing that the
    safety filter checks, and sends what it is told.
    """

    def connect(self) -> None:
        """Open the connection and wait for a first reading; nothing moves.

        Raises:
            DriverError: nobody answers, or not as expected.
        """

    def read(self) -> JointState:
        """Return the newest reading, which may be an old one: its stamp says when it was taken.

        Raises:
            DriverError: the connection is lost.
        """

    def command(self, target: Array) -> Array:
        """Send a target (J,) rad; return the target that was really sent, (J,) rad.

        Raises:
            DriverError: the connection is lost.
        """

    def hold(self) -> None:
        """Tell the arm to stay where it is. Never raises: it is the last resort.

        May be called from another thread, while `read` or `command` hangs.
        """

    def close(self) -> None:
        """Hold, and end the connection; may be called twice, and without `connect`."""


@runtime_checkable
class ObjectSource(Protocol):
    """A driver, or something beside it, that sees the object."""

    def object_pose(self) -> ObjectPose:
        """Return the newest pose of the object; its stamp says when it was taken.

        Raises:
            DriverError: the connection is lost.
        """


@runtime_checkable
class Resettable(Protocol):
    """A driver whose arm and scene can be put back to the start by itself, as only a simulated one can."""

    @property
    def speed(self) -> float:
        """Return how many of the arm's seconds pass in a second of the machine's clock."""

    @property
    def patience(self) -> float:
        """Return how much longer than with a real arm readings and the loop may take, s: its machine may be busy."""

    def reset(self, episode: int) -> None:
        """Put arm and object to the start of an episode, counted from 0; returns with a reading from there.

        Raises:
            DriverError: the connection is lost.
        """


def order_of(told: Sequence[str], wanted: Sequence[str]) -> tuple[int, ...]:
    """Return where each wanted joint stands among those a driver tells.

    Raises:
        DriverError: the names differ.
    """
    if sorted(told) != sorted(wanted):
        raise DriverError(
            f"the arm's joints are not those of the robot file; expected {', '.join(wanted)}; got {', '.join(told)}",
            "name the joints in the robot file or in the driver's settings as the arm names them, in any order",
        )
    return tuple(list(told).index(name) for name in wanted)
