"""The driver `franka` without its packages: against a module with the shapes of franky, above all when an arm stops itself."""

from __future__ import annotations

import enum
import importlib
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from execution.conformance import DriverConformance
from execution.drivers.failing import failure

from skillcli.execution.driver import Driver, DriverError
from skillcli.robots.robot import load_robot

pytestmark = pytest.mark.real_time

TAU = 0.03  # s, of the arm


class RobotMode(enum.Enum):
    Other, Idle, Move, Guiding, Reflex, UserStopped = range(6)


class ControlException(Exception):
    pass


class JointReference:
    def __init__(self, q: Any) -> None:
        assert np.isfinite(q).all()
        self.q = np.array(q)


class JointImpedanceTrackingMotion:
    def __init__(self, stiffness: Any, damping: Any) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.references: list[Any] = []

    def set_reference(self, reference: JointReference) -> None:
        self.references.append(reference.q)


class TorqueStopMotion:
    pass


class Robot:
    """Follows the reference of its motion; `trouble` is raised by everything, `hung` lets the state wait, as libfranka does."""

    made: list[Robot] = []  # noqa: RUF012
    refuses: Exception | None = None

    def __init__(self, host: str, **given: Any) -> None:
        if Robot.refuses is not None:
            raise Robot.refuses
        self.host, self.given = host, given
        self.is_in_control = False
        self.mode, self.motion_error, self.trouble = RobotMode.Idle, None, None
        self.hung, self.still = threading.Event(), False
        self.moves: list[Any] = []
        self.motion: Any = None
        self._position = np.array([0.0, -0.2, 0.0, -2.5, 0.0, 2.3, 0.8])
        self._moved, self._told = time.monotonic(), 0
        Robot.made.append(self)

    @property
    def state(self) -> Any:
        if self.hung.is_set():
            time.sleep(0.3)
        if self.trouble is not None:
            raise self.trouble
        now = time.monotonic()
        before, seconds = self._position, max(now - self._moved, 1e-6)
        target = self.motion.references[-1] if self.is_in_control else before
        self._position = before + (target - before) * -np.expm1(-seconds / TAU)
        self._moved = now
        self._told += 0 if self.still else 1
        stamp = SimpleNamespace(to_msec=lambda told=self._told: told)
        return SimpleNamespace(q=self._position, dq=(self._position - before) / seconds, time=stamp, robot_mode=self.mode)

    def move(self, motion: Any, asynchronous: bool = False, cutoff_frequency: float = 100.0) -> None:
        assert asynchronous, "else it returns when the arm is there"
        if self.trouble is not None:
            raise self.trouble
        self.moves.append(motion)
        self.is_in_control = isinstance(motion, JointImpedanceTrackingMotion)
        if self.is_in_control:
            self.motion = motion
            assert np.abs(motion.references[-1] - self._position).max() < 1e-3, "it would jump"

    def poll_motion(self) -> bool:
        error, self.motion_error = self.motion_error, None
        if error is not None:
            raise error
        return self.is_in_control

    def join_motion(self, timeout: float) -> bool:
        return True


@pytest.fixture
def franka(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The driver's module, which imported our franky."""
    franky: Any = ModuleType("franky")
    franky.Robot, franky.RobotMode, franky.ControlException = Robot, RobotMode, ControlException
    franky.JointReference, franky.TorqueStopMotion = JointReference, TorqueStopMotion
    franky.JointImpedanceTrackingMotion = JointImpedanceTrackingMotion
    franky.RealtimeConfig = SimpleNamespace(Enforce="enforce", Ignore="ignore")
    monkeypatch.setitem(sys.modules, "franky", franky)
    monkeypatch.delitem(sys.modules, "skillcli.execution.drivers.franka", raising=False)
    monkeypatch.setattr(Robot, "refuses", None)
    yield importlib.import_module("skillcli.execution.drivers.franka")
    sys.modules.pop("skillcli.execution.drivers.franka")


class TestFrankaShapes(DriverConformance):
    names = tuple(f"joint{number}" for number in range(1, 8))

    @pytest.fixture
    def driver(self, franka: Any) -> Iterator[Driver]:
        yield franka.open_driver({"host": "arm"}, load_robot("panda"))


@pytest.fixture
def driver(franka: Any) -> Iterator[Any]:
    with closing(franka.open_driver({"host": "arm", "timeout": 0.5}, load_robot("panda"))) as driver:
        driver.connect()
        yield driver


@pytest.fixture
def arm(driver: Any) -> Robot:
    return Robot.made[-1]


def test_settings_reach_the_arm(franka: Any) -> None:
    gains = {"stiffness": [100.0] * 7, "damping": [20.0] * 7}
    given = {"host": "172.16.0.2", **gains, "torque": 10.0, "force": 15.0, "realtime": False}
    with closing(franka.open_driver(given, load_robot("panda"))) as driver:
        driver.connect()
        arm = Robot.made[-1]
        driver.command(driver.read().position)
        assert arm.host == "172.16.0.2" and (arm.motion.stiffness == 100).all() and (arm.motion.damping == 20).all()
        thresholds = {"default_torque_threshold": 10.0, "default_force_threshold": 15.0}
        assert arm.given == {**thresholds, "realtime_config": "ignore"}


def test_a_real_time_kernel_is_asked_for_unless_told_otherwise(arm: Robot) -> None:
    assert arm.given["realtime_config"] == "enforce"


def test_the_reference_goes_from_where_the_arm_is_to_each_target(driver: Any, arm: Robot) -> None:
    start = driver.read().position
    driver.command(start + 0.05)
    time.sleep(0.15)
    way = np.array(arm.motion.references)[:, 0] - start[0]
    assert way[0] == pytest.approx(0, abs=1e-6) and way[-1] == pytest.approx(0.05)
    assert (np.diff(way) >= -1e-9).all() and np.diff(way).max() < 0.04 and len(arm.moves) == 1
    driver.command(start)
    time.sleep(0.15)
    assert arm.motion.references[-1] == pytest.approx(start) and len(arm.moves) == 1, "one motion lasts"


def test_a_far_target_is_gone_to_as_fast_as_torques_may_change(franka: Any) -> None:
    reference = franka.Reference(np.zeros(2), np.array([700.0, 70.0]))
    reference.lead(np.array([0.02, 0.0]), 1.0, 0.05)
    assert reference.at(1.025) == pytest.approx([0.01, 0.0]) and reference.at(1.06) == pytest.approx([0.02, 0.0])
    reference.lead(np.array([0.52, 0.1]), 2.0, 0.05)  # 350 N·m in half a second
    assert reference.at(2.25) == pytest.approx([0.27, 0.05]) and reference.at(3.0) == pytest.approx([0.52, 0.1])
    reference.stay(np.array([0.3, 0.0]))
    assert reference.at(3.0) == pytest.approx([0.3, 0.0])


def test_a_hold_pulls_to_the_measured_position_of_an_arm_that_we_move(driver: Any, arm: Robot) -> None:
    driver.hold()
    assert arm.moves == []
    far = driver.read().position + 1.0
    driver.command(far)
    time.sleep(0.05)
    driver.hold()
    time.sleep(0.15)
    held = arm.motion.references[-1]
    assert (held < far - 0.5).all()
    time.sleep(0.1)
    assert arm.motion.references[-1] == pytest.approx(held)


def test_closing_brakes_to_rest(driver: Any, arm: Robot) -> None:
    driver.command(driver.read().position)
    driver.close()
    assert isinstance(arm.moves[-1], TorqueStopMotion) and not arm.is_in_control


def test_a_target_that_is_not_finite_does_not_become_the_reference(driver: Any, arm: Robot) -> None:
    driver.command(driver.read().position)
    with pytest.raises(DriverError, match="not finite"):
        driver.command(np.full(7, np.nan))
    time.sleep(0.05)
    assert np.isfinite(driver.read().position).all() and np.isfinite(arm.motion.references).all()


def test_an_arm_that_stops_itself_says_why(driver: Any, arm: Robot) -> None:
    target = driver.read().position
    driver.command(target)
    arm.motion_error = ControlException('libfranka: Move command aborted: motion aborted by reflex! ["cartesian_reflex"]')
    arm.mode = RobotMode.Reflex
    error = failure(driver)
    assert "mode Reflex" in error.message and "cartesian_reflex" in error.message and "recover" in error.hint
    with pytest.raises(DriverError, match="mode Reflex"):
        driver.command(target)
    driver.hold()


def test_a_motion_that_failed_is_told_by_the_next_command(driver: Any, arm: Robot) -> None:
    target = driver.read().position
    arm.motion_error = ControlException("communication_constraints_violation")
    with pytest.raises(DriverError, match="ControlException: communication_constraints_violation"):
        driver.command(target)


@pytest.mark.parametrize("mode", [RobotMode.Other, RobotMode.UserStopped, RobotMode.Guiding])
def test_an_arm_that_is_not_ready_is_refused(franka: Any, monkeypatch: pytest.MonkeyPatch, mode: RobotMode) -> None:
    started = Robot.__init__

    def blocked(self: Robot, host: str, **given: Any) -> None:
        started(self, host, **given)
        self.mode = mode

    monkeypatch.setattr(Robot, "__init__", blocked)
    driver = franka.open_driver({"host": "arm"}, load_robot("panda"))
    with pytest.raises(DriverError, match=f"in mode {mode.name}; expected Idle or Move"):
        driver.connect()
    driver.close()


def test_readings_of_an_arm_whose_clock_stands_still_grow_old(driver: Any, arm: Robot) -> None:
    arm.still = True
    time.sleep(0.2)
    assert time.monotonic() - driver.read().stamp > 0.1


def test_a_state_that_is_waited_for_delays_nobody(driver: Any, arm: Robot) -> None:
    arm.hung.set()
    time.sleep(0.02)
    began = time.monotonic()
    driver.read()
    driver.hold()
    assert time.monotonic() - began < 0.05


def test_a_lost_connection_is_told(driver: Any, arm: Robot) -> None:
    arm.trouble = RuntimeError("libfranka: UDP receive: Timeout")
    assert failure(driver).message == "the arm no longer answers: RuntimeError: libfranka: UDP receive: Timeout"
    driver.hold()


def test_an_arm_that_refuses_is_told(franka: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        Robot, "refuses", ConnectionError("Incompatible library version (server version: 5, library version: 10)")
    )
    driver = franka.open_driver({"host": "arm"}, load_robot("panda"))
    with pytest.raises(DriverError, match=r"no Franka arm at arm: .*server version: 5") as told:
        driver.connect()
    assert "driver-franka.md" in told.value.hint
    driver.hold()
    driver.close()
