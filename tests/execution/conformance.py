"""What every driver must do. A driver's test inherits `DriverConformance`, names its joints and says how to open one.

    class TestMyDriver(DriverConformance):
        names = ("j0", "j1")

        @pytest.fixture
        def driver(self) -> Iterator[Driver]:
            ...  # start what the driver connects to
            yield MyDriver(...)  # not connected yet
            ...  # stop it

Every test opens a driver of its own, moves one joint a little at most, and takes a second or two.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import numpy as np
import pytest

from skillcli.execution.driver import Driver, DriverError, JointState
from skillcli.trajectories import Array

SLOWEST_CALL = 0.05  # s, of the middle one of many calls: a control period
FRESH = 0.5  # s, a newer reading comes within


@contextmanager
def connected(driver: Driver) -> Iterator[Driver]:
    """Connect, and close whatever happens."""
    try:
        driver.connect()
        yield driver
    finally:
        driver.close()


def fresh(driver: Driver, after: float, within: float = 2.0) -> JointState:
    """Wait for a reading that was taken after a moment of `time.monotonic`."""
    until = time.monotonic() + within
    while (state := driver.read()).stamp <= after:
        assert time.monotonic() < until, f"no reading newer than {after} within {within} s"
        time.sleep(0.002)
    return state


class DriverConformance:
    """Tests of the protocol; a subclass gives `names` and the fixture `driver`."""

    names: ClassVar[tuple[str, ...]]  # of the joints, in order
    joint: ClassVar[int] = -1  # which joint is moved
    step: ClassVar[float] = 0.02  # rad, by how much
    settled: ClassVar[float] = 0.5  # s, after which the joint has gone most of this way
    follows: ClassVar[bool] = True  # whether the arm behind the driver moves at all

    @pytest.fixture
    def driver(self) -> Iterator[Driver]:
        raise NotImplementedError("a subclass opens its driver")

    def test_a_reading_has_the_names_and_a_number_for_each(self, driver: Driver) -> None:
        with connected(driver):
            state = driver.read()
            assert isinstance(state, JointState)
            assert isinstance(state.names, tuple) and state.names == self.names
            for values in (state.position, state.velocity):
                assert isinstance(values, np.ndarray) and values.shape == (len(self.names),)
                assert np.issubdtype(values.dtype, np.floating) and np.isfinite(values).all()

    def test_a_reading_is_in_radians_and_of_an_arm_at_rest(self, driver: Driver) -> None:
        with connected(driver):
            state = driver.read()
            assert np.abs(state.position).max() < 4 * math.pi, "degrees?"
            assert np.abs(state.velocity).max() < 0.2, "nothing has moved it yet"

    def test_connect_moves_nothing(self, driver: Driver) -> None:
        with connected(driver):
            first = driver.read()
            later = fresh(driver, first.stamp + 0.2) if self.follows else driver.read()
            assert np.abs(later.position - first.position).max() < 0.02

    def test_stamps_are_on_the_monotonic_clock_and_never_go_back(self, driver: Driver) -> None:
        with connected(driver):
            stamps = []
            until = time.monotonic() + FRESH
            while time.monotonic() < until:
                state, now = driver.read(), time.monotonic()
                assert -0.005 < now - state.stamp < FRESH
                stamps.append(state.stamp)
                time.sleep(0.005)
            assert (np.diff(stamps) >= 0).all()
            assert stamps[-1] > stamps[0], "readings stay as old as the first one"

    def test_calls_return_at_once(self, driver: Driver) -> None:
        with connected(driver):
            took = []
            target = driver.read().position.copy()
            for _ in range(20):
                began = time.monotonic()
                driver.read()
                driver.command(target)
                took.append(time.monotonic() - began)
                time.sleep(0.02)
            assert float(np.median(took)) < SLOWEST_CALL

    def test_a_command_tells_what_was_sent_and_the_arm_follows(self, driver: Driver) -> None:
        with connected(driver):
            before = driver.read().position.copy()
            target = before.copy()
            target[self.joint] += self.step
            asked = target.copy()
            sent = self._send(driver, target)
            assert np.array_equal(target, asked), "the caller's array was changed"
            assert isinstance(sent, np.ndarray) and sent.shape == target.shape
            assert np.allclose(sent, target, atol=1e-3)
            if self.follows:
                moved = fresh(driver, time.monotonic()).position - before
                assert moved[self.joint] > self.step / 2
                assert np.abs(np.delete(moved, self.joint)).max() < self.step, "other joints moved"

    def test_after_a_hold_the_arm_stays(self, driver: Driver) -> None:
        with connected(driver):
            target = driver.read().position.copy()
            target[self.joint] += self.step
            self._send(driver, target, seconds=0.1)
            driver.hold()
            driver.hold()
            time.sleep(self.settled)
            first = driver.read()
            time.sleep(self.settled)
            assert np.abs(driver.read().position - first.position).max() < self.step / 2

    def test_a_hold_never_raises(self, driver: Driver) -> None:
        driver.hold()
        with connected(driver):
            driver.hold()
        driver.hold()

    def test_before_connect_there_is_nothing_to_read_or_command(self, driver: Driver) -> None:
        with pytest.raises(DriverError):
            driver.read()
        with pytest.raises(DriverError):
            driver.command(np.zeros(len(self.names)))

    def test_after_close_every_call_is_refused(self, driver: Driver) -> None:
        with connected(driver):
            target = driver.read().position.copy()
        with pytest.raises(DriverError):
            driver.read()
        with pytest.raises(DriverError):
            driver.command(target)

    def test_close_may_come_twice_and_without_connect(self, driver: Driver) -> None:
        driver.close()
        driver.close()

    def test_close_may_come_twice_after_connect(self, driver: Driver) -> None:
        driver.connect()
        driver.close()
        driver.close()

    def _send(self, driver: Driver, target: Array, seconds: float | None = None) -> Array:
        """Send a target at 20 Hz until the arm should be there, as a control loop does; return what was sent."""
        until = time.monotonic() + (self.settled if seconds is None else seconds)
        while True:
            sent = driver.command(target)
            if time.monotonic() >= until:
                return sent
            time.sleep(0.05)
