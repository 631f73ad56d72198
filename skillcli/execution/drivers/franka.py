"""A Franka arm, through franky over libfranka: one motion of joint impedance, whose reference follows the targets.

Motions in position, one for each target, were tried and given up: each plans anew from the desired velocity and acceleration
that the arm reports. When those come late, 20 plans a second can run away by radians.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any

import franky
import numpy as np
from pydantic import Field

from skillcli.config.base import value
from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError, JointState
from skillcli.execution.drivers.readings import PolledDriver, lost
from skillcli.execution.drivers.settings import ArmSettings, read_settings
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array

JOINTS = 7
READ_PERIOD = 0.004  # s, between two readings, and two steps of the reference
END_TIMEOUT = 2.0  # s, for the arm to come to rest; libfranka notices after 1 s that nobody answers
# N·m/s, of which the arm allows 1000. At its limit the torque comes too late: springs of 600 N·m/rad whose reference jumps
# by 0.2 rad then swing up until the arm hits its limits.
TORQUE_RATE = 700.0
NO_FILTER = 1000.0  # Hz, libfranka's kMaxCutoffFrequency, which franky names but does not export
STIFFEST = 1500.0  # N·m/rad: that of a real arm is limited by the delay of its loop of 1 ms
Gain = Annotated[float, Field(gt=0, le=STIFFEST)]
Gains = tuple[Gain, Gain, Gain, Gain, Gain, Gain, Gain]
READY = (franky.RobotMode.Idle, franky.RobotMode.Move)


class FrankaSettings(ArmSettings):
    """Settings of the driver; docs/driver-franka.md explains them."""

    host: str = value(..., "address of the arm's control unit", "", min_length=1)
    stiffness: Gains = value((600, 600, 600, 600, 250, 150, 50), "of each joint; those of libfranka's example", "N·m/rad")
    damping: Gains = value((50, 50, 50, 50, 30, 25, 15), "of each joint", "N·m·s/rad")
    ramp: float = value(0.02, "in which the reference goes to a target, if the arm allows", "s", ge=0, le=0.5)
    realtime: bool = value(True, "whether to refuse a kernel without real-time scheduling", "")
    torque: float = value(20.0, "external torque at a joint that stops the arm", "N·m", gt=0, le=100)
    force: float = value(30.0, "external force at the hand that stops the arm", "N", gt=0, le=200)


def open_driver(settings: Mapping[str, object], robot: Robot) -> FrankaDriver:
    """Return a driver that is not connected yet.

    Raises:
        UsageError: the settings are invalid, or the robot file has another number of joints.
    """
    read = read_settings(FrankaSettings, settings, "franka", robot)
    if robot.joint_count != JOINTS:
        raise UsageError(
            f"driver franka: a Franka arm has {JOINTS} joints, {robot.name!r} has {robot.joint_count}", "choose another --robot"
        )
    return FrankaDriver(read, tuple(robot.description.joints))


class Reference:
    """The joint angles that the arm's springs pull to: they go straight from each target to the next.

    Args:
        start: where they begin, (7,) rad.
        stiffness: of the springs, (7,) N·m/rad: it limits how fast the reference goes.
    """

    def __init__(self, start: Array, stiffness: Array) -> None:
        self._begin = self._end = start
        self._since, self._ramp, self._stiffness = 0.0, 0.0, stiffness

    def lead(self, target: Array, now: float, ramp: float) -> None:
        """Go to a target (7,) rad, from `now` s on, in `ramp` s, or more slowly where torques would change too fast."""
        self._begin, self._end, self._since = self.at(now), target, now
        self._ramp = max(ramp, float(np.max(np.abs(target - self._begin) * self._stiffness)) / TORQUE_RATE)

    def stay(self, here: Array) -> None:
        """Be at angles (7,) rad, where the arm is."""
        self._begin = self._end = here

    def at(self, now: float) -> Array:
        """Return the angles (7,) rad at a moment, s."""
        done = min(1.0, (now - self._since) / self._ramp) if self._ramp else 1.0
        return np.asarray(self._begin + done * (self._end - self._begin))


class FrankaDriver(PolledDriver):
    """A Franka arm; see `Driver`.

    If no other target follows, the arm comes to rest at the last; if our process dies, the control unit stops the arm.

    Args:
        settings: see `FrankaSettings`.
        names: of the joints, from the base to the hand.
    """

    def __init__(self, settings: FrankaSettings, names: tuple[str, ...]) -> None:
        super().__init__(READ_PERIOD, settings.timeout)
        self._settings, self._names = settings, names
        self._told: object = None  # the arm's own time of the last reading
        self._motion: Any = None  # from the first command on
        self._reference = Reference(np.zeros(JOINTS), np.array(settings.stiffness))
        self._referring = threading.Lock()  # so that no older reference follows a newer one

    def command(self, target: Array) -> Array:
        """Lead the reference to a target (7,) rad; see `Driver`."""
        measured = self.read().position  # raises what stopped the arm
        sent = np.array(target, dtype=float)
        if not np.isfinite(sent).all():
            raise DriverError(f"a target is not finite: {sent.tolist()}", "the reference stays where it is")
        try:
            self._robot.poll_motion()
            with self._referring:
                if self._motion is None:
                    self._reference.stay(measured)
                self._reference.lead(sent, time.monotonic(), self._settings.ramp)
            if self._motion is None:
                self._begin(measured)
            self._refer()
        except Exception as error:
            raise lost(error) from None
        return sent

    def hold(self) -> None:
        """Pull to the measured position; an arm that we do not move holds itself; see `Driver`."""
        with suppress(Exception):
            if self._motion is not None and self._poller is not None:
                now = time.monotonic()
                try:
                    here = self._poller.newest().position
                except DriverError:
                    here = self._reference.at(now)
                with self._referring:
                    self._reference.lead(here, now, 0.0)
                self._refer()

    def close(self) -> None:
        """Brake to rest, give control back to the arm, which then holds itself, and end the connection; see `Driver`."""
        robot, poller = self._robot, self._poller
        if robot is None:
            return
        self.hold()
        with suppress(Exception):
            if robot.is_in_control:
                robot.move(franky.TorqueStopMotion(), asynchronous=True)
                robot.join_motion(END_TIMEOUT)
        if poller is not None:
            poller.stop(END_TIMEOUT)
        self._robot = self._poller = self._motion = None

    def _made(self) -> Any:
        given = self._settings
        config = franky.RealtimeConfig.Enforce if given.realtime else franky.RealtimeConfig.Ignore
        return franky.Robot(
            given.host, default_torque_threshold=given.torque, default_force_threshold=given.force, realtime_config=config
        )

    def _unanswered(self) -> DriverError:
        return DriverError(
            f"no Franka arm at {self._settings.host}: no answer within {self._settings.timeout:g} s",
            "check `host`, and that its network is yours",
        )

    def _refused(self, error: Exception) -> DriverError:
        return DriverError(
            f"no Franka arm at {self._settings.host}: {type(error).__name__}: {error}",
            "unlock the brakes, activate FCI in Desk, and see docs/driver-franka.md for versions and real-time kernels",
        )

    def _begin(self, here: Array) -> None:
        """Take control, with the reference where the arm is, (7,) rad."""
        given = self._settings
        motion = franky.JointImpedanceTrackingMotion(stiffness=np.array(given.stiffness), damping=np.array(given.damping))
        motion.set_reference(franky.JointReference(q=here))
        # no low-pass filter: by its delay, the limit of the torque's rate would be a third of the arm's
        self._robot.move(motion, asynchronous=True, cutoff_frequency=NO_FILTER)
        self._motion = motion

    def _refer(self) -> None:
        """Give the control thread the reference of this moment."""
        with self._referring:
            if self._motion is not None:
                self._motion.set_reference(franky.JointReference(q=self._reference.at(time.monotonic())))

    def _measure(self) -> JointState | None:
        """Ask for the state. While the arm moves, it is that of the control thread, which repeats when the arm falls silent."""
        robot = self._robot
        self._refer()  # here, since this thread comes by often
        state = robot.state
        stamp, told = time.monotonic(), state.time.to_msec()
        if state.robot_mode not in READY:
            raise self._stopped(robot, state)
        if told == self._told:
            return None
        self._told = told
        return JointState(self._names, np.array(state.q, dtype=float), np.array(state.dq, dtype=float), stamp)

    def _stopped(self, robot: Any, state: Any) -> DriverError:
        """Say why an arm that was ready no longer is."""
        reason = ""
        try:
            robot.poll_motion()
        except Exception as error:
            reason = f": {error}"
        return DriverError(
            f"the arm is in mode {state.robot_mode.name}{reason}; expected Idle or Move",
            "look why it stopped, release the stop button, unlock and recover it in Desk, then start again",
        )
