"""The driver `franka`: against franky-sim, which speaks libfranka's protocol, where both packages are installed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from execution.conformance import DriverConformance, connected

from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError
from skillcli.robots.robot import load_robot

pytest.importorskip("franky")
pytest.importorskip("franky_sim")

from skillcli.execution.drivers.franka import FrankaDriver, open_driver

pytestmark = pytest.mark.real_time  # a simulation of a millisecond per step, in a process of its own

NAMES = tuple(f"joint{number}" for number in range(1, 8))
PERIOD = 0.05  # s


class Peer:
    """franky-sim in a process."""

    def __init__(self) -> None:
        command = [sys.executable, str(Path(__file__).with_name("franka_server.py"))]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.host = self.process.stdout.readline().strip()

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.end()


def driver_at(host: str, **given: object) -> FrankaDriver:
    return open_driver({"host": host, "realtime": False, "timeout": 3.0, **given}, load_robot("panda"))


class TestFranka(DriverConformance):
    names = NAMES
    settled = 1.0

    @pytest.fixture
    def driver(self, peer: Peer) -> Iterator[FrankaDriver]:  # type: ignore[override]
        yield driver_at(peer.host)


@pytest.fixture
def driver(peer: Peer) -> Iterator[FrankaDriver]:
    with closing(driver_at(peer.host)) as driver:
        driver.connect()
        yield driver


PANDA = {"stiffness": [800.0] * 4 + [400.0] * 3, "damping": [40.0] * 4 + [20.0] * 3}  # as in the robot file's model


@pytest.mark.parametrize(("gains", "slowest"), [({}, 0.4), (PANDA, 0.35)])  # s, on a busy machine
def test_targets_at_20_hz_are_followed_with_the_lag_of_ramp_and_springs(
    peer: Peer, gains: dict[str, object], slowest: float
) -> None:
    times, measured = [], []
    with connected(driver_at(peer.host, **gains)) as driver:
        start = driver.read().position
        began = time.monotonic()
        for step in range(80):  # 4 s, 0.2 rad to and fro
            driver.command(start + 0.1 * (1 - np.cos(np.pi * step * PERIOD)))
            while time.monotonic() < began + (step + 1) * PERIOD:
                state = driver.read()
                times.append(state.stamp - began)
                measured.append(state.position - start)
                time.sleep(0.005)
    time_, moved = np.array(times), np.array(measured)
    assert np.abs(moved).max() < 0.25, "nothing runs away"
    lags = np.arange(0, 0.5, 0.01)
    errors = [np.abs(moved - 0.1 * (1 - np.cos(np.pi * (time_ - lag)))[:, None])[time_ > 1].mean() for lag in lags]
    assert lags[np.argmin(errors)] < slowest and min(errors) < 0.03


def test_a_hold_stops_a_fast_arm(driver: FrankaDriver) -> None:
    start = driver.read().position
    for step in range(1, 11):  # 0.6 rad/s
        target = start + 0.03 * step * np.eye(7)[0]
        driver.command(target)
        time.sleep(PERIOD)
    assert driver.read().velocity[0] > 0.3
    driver.hold()
    at_hold = driver.read().position[0]
    time.sleep(0.8)
    held = driver.read()
    assert np.abs(held.velocity[:6]).max() < 0.02 and abs(held.position[0] - at_hold) < 0.05
    driver.command(held.position)  # and goes on after it
    time.sleep(0.2)
    assert np.abs(driver.read().position - held.position).max() < 0.02


def test_without_another_target_the_arm_comes_to_rest_at_the_last(driver: FrankaDriver) -> None:
    target = driver.read().position + 0.3  # at once, in every joint, more than a filter would let pass
    driver.command(target)
    time.sleep(3.0)
    state = driver.read()
    assert state.position == pytest.approx(target, abs=0.02)
    assert np.abs(state.velocity[:6]).max() < 0.02  # the simulated servo of the last joint never quite rests


@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGSTOP])
def test_an_arm_that_falls_silent_looks_old_at_once_and_is_lost_after_a_second(
    driver: FrankaDriver, peer: Peer, stop: int
) -> None:
    target = driver.read().position + 0.1
    driver.command(target)
    time.sleep(0.2)
    os.kill(peer.process.pid, stop)
    time.sleep(0.3)
    began = time.monotonic()
    assert began - driver.read().stamp > 0.2
    driver.hold()
    assert time.monotonic() - began < 0.05
    with pytest.raises(DriverError, match="no longer answers"):
        while time.monotonic() - began < 4:
            driver.read()
            time.sleep(0.01)
    with pytest.raises(DriverError):
        driver.command(target)
    driver.hold()


def test_nobody_there_is_told_at_once() -> None:
    with closing(driver_at("127.9.9.9")) as driver, pytest.raises(DriverError, match=r"no Franka arm at 127\.9\.9\.9.*refused"):
        driver.connect()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "host: missing"),
        ({"host": "arm", "stiffness": [1.0]}, "stiffness: expected seven numbers"),
        ({"host": "arm", "ip": "1"}, "ip: unknown"),
    ],
)
def test_wrong_settings_are_refused(given: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError) as told:
        open_driver(given, load_robot("panda"))
    assert said in told.value.message


def test_an_arm_with_other_joints_is_refused() -> None:
    with pytest.raises(UsageError, match="has 7 joints, 'ur5e' has 6"):
        open_driver({"host": "arm"}, load_robot("ur5e"))
