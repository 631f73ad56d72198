"""Readings of an arm that is asked in a thread of its own, that tells no velocities, or that has another clock."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from skillcli.execution.driver import DriverError, JointState
from skillcli.trajectories import Array

WINDOW = 0.05  # s, over which a velocity is estimated: shorter, and the steps of a hobby servo's encoder dominate
FORGET = 1e-3  # s per s, faster than any two clocks drift apart

Result = TypeVar("Result")


class VelocityEstimator:
    """Velocities of an arm that tells positions only: the change over the last `WINDOW` seconds."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, Array]] = deque()

    def update(self, stamp: float, position: Array) -> Array:
        """Return the velocity (J,) rad/s at a newer position (J,) rad, taken at `stamp` s; zeros for the first."""
        self._past.append((stamp, position))
        while len(self._past) > 2 and self._past[1][0] <= stamp - WINDOW:
            self._past.popleft()
        begun, first = self._past[0]
        return (position - first) / (stamp - begun) if stamp > begun else np.zeros_like(position)


class RemoteClock:
    """Translates stamps of another machine's clock into ours.

    The quickest message so far is taken to be without delay. One that waited in a queue then looks as old as it is, though
    it arrives just now; and after the other clock jumped back, everything looks old, which stops the arm.
    """

    def __init__(self) -> None:
        self._offset = np.inf  # s, from their clock to ours
        self._last = 0.0  # s, our clock

    def local(self, told: float, arrived: float) -> float:
        """Return when something was measured, s on our clock.

        Args:
            told: when it was measured, s on their clock.
            arrived: when we got it, s on our clock.
        """
        # by forgetting slowly, clocks that run at different speeds do not make readings look older and older
        self._offset = min(self._offset + FORGET * (arrived - self._last), arrived - told)
        self._last = arrived
        return told + float(self._offset)


class Poller:
    """Asks an arm for readings in a daemon thread, since an answer may take longer than the control loop can wait.

    Args:
        measure: waits for a reading; returns None if there is none newer than the last.
        period: pause between two questions, s.
    """

    def __init__(self, measure: Callable[[], JointState | None], period: float) -> None:
        self._measure, self._period = measure, period
        self._state: JointState | None = None
        self._error: Exception | None = None
        self._told, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="arm readings", daemon=True)

    def start(self, timeout: float) -> None:
        """Begin, and wait for the first reading for at most `timeout` s.

        Raises:
            DriverError: there is none, or it fails.
        """
        self._thread.start()
        if not self._told.wait(timeout):
            raise DriverError(f"the arm tells nothing; expected a first reading within {timeout:g} s", "is it switched on?")
        self.newest()

    def newest(self) -> JointState:
        """Return the newest reading.

        Raises:
            DriverError: asking failed; there will be no other one.
        """
        if self._error is not None:
            raise lost(self._error)
        assert self._state is not None, "start() waits for it"
        return self._state

    def stop(self, timeout: float) -> None:
        """End, after the question that is being asked, or after `timeout` s."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                state = self._measure()
            except Exception as error:
                self._error = error
                self._told.set()
                return
            if state is not None:
                self._state = state
                self._told.set()
            self._ending.wait(self._period)


class PolledDriver(ABC):
    """A driver that is one object of another library, whose readings a thread asks for.

    Args:
        period: pause between two readings, s.
        timeout: longest wait for the connection, then for the first reading, s.
    """

    def __init__(self, period: float, timeout: float) -> None:
        self._period, self._timeout = period, timeout
        self._robot: Any = None
        self._poller: Poller | None = None

    @abstractmethod
    def _made(self) -> Any:
        """Return the connected object of the other library."""

    @abstractmethod
    def _measure(self) -> JointState | None:
        """See `Poller`."""

    @abstractmethod
    def _unanswered(self) -> DriverError:
        """Say that the connection was not there in time."""

    @abstractmethod
    def _refused(self, error: Exception) -> DriverError:
        """Say that the connection failed."""

    @abstractmethod
    def close(self) -> None:
        """See `Driver`."""

    def connect(self) -> None:
        """Connect, and wait for a first reading; see `Driver`."""
        if self._robot is not None:
            raise not_connected()
        try:
            self._robot = within(self._timeout, self._made)
        except TimeoutError:
            raise self._unanswered() from None
        except DriverError:
            raise
        except Exception as error:
            raise self._refused(error) from None
        self._poller = Poller(self._measure, self._period)
        try:
            self._poller.start(self._timeout)
        except DriverError:
            self.close()
            raise

    def read(self) -> JointState:
        """Return the newest reading; see `Driver`."""
        if self._poller is None:
            raise not_connected()
        return self._poller.newest()


def lost(error: Exception) -> DriverError:
    """Say that an arm no longer answers, for whatever reason."""
    if isinstance(error, DriverError):
        return error
    return DriverError(
        f"the arm no longer answers: {type(error).__name__}: {error}",
        "look at the arm and at its cable or network, then start again",
    )


def not_connected() -> DriverError:
    """Say that `connect` was not called, or `close` was."""
    return DriverError("the driver is not connected to the arm", "call connect() first, once, and nothing after close()")


def within(seconds: float, call: Callable[[], Result]) -> Result:
    """Return the result of a call that may hang, from a daemon thread.

    Raises:
        TimeoutError: it takes longer than `seconds`; the thread is left to itself.
        Exception: whatever the call raises.
    """
    results: list[Result] = []
    errors: list[Exception] = []

    def run() -> None:
        try:
            results.append(call())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="arm connection", daemon=True)
    thread.start()
    thread.join(seconds)
    if errors:
        raise errors[0]
    if not results:
        raise TimeoutError(f"no answer within {seconds:g} s")
    return results[0]
