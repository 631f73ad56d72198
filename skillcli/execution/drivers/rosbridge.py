"""An arm on ROS, through a rosbridge server: joint states in, joint commands out."""

from __future__ import annotations

import logging
import math
import socket
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal

import numpy as np
import roslibpy
from pydantic import Field

from skillcli.config.base import Section, value
from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError, JointState
from skillcli.execution.drivers.readings import RemoteClock, VelocityEstimator, not_connected
from skillcli.execution.drivers.settings import NamedSettings, read_settings
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array

CommandType = Literal[
    "intera_core_msgs/JointCommand", "trajectory_msgs/JointTrajectory", "std_msgs/Float64MultiArray",
    "trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Float64MultiArray",
]  # fmt: skip
POSITION_MODE = 1  # of intera_core_msgs/JointCommand
HOLD_PERIOD = 0.05  # s, between two repetitions of a hold: a Sawyer forgets a command after 0.2 s
END_TIMEOUT = 1.0  # s, for the bridge to agree that the connection ends

# roslibpy logs what we raise ourselves; without a handler, Python would print it.
logging.getLogger("roslibpy").addHandler(logging.NullHandler())


class States(Section):
    """Where joint states come from: `sensor_msgs/JointState`."""

    topic: str = value("/joint_states", "of the joint states", "", min_length=1)
    type: Literal["sensor_msgs/JointState", "sensor_msgs/msg/JointState"] = value(
        "sensor_msgs/JointState", "of their messages", ""
    )


class Commands(Section):
    """Where commands go, and as which message."""

    topic: str = value(..., "of the commands", "", min_length=1)
    type: CommandType = value(..., "of their messages", "")
    seconds: float = value(0.1, "in which a JointTrajectory is to reach its one point", "s", gt=0, le=2)
    order: tuple[str, ...] = value((), "the arm's names in the order of a Float64MultiArray, if not that of `joints`", "")


class RosbridgeSettings(NamedSettings):
    """Settings of the driver; docs/driver-rosbridge.md explains them."""

    host: str = value("127.0.0.1", "name or address of the machine that the rosbridge server runs on", "", min_length=1)
    port: int = value(9090, "of the server", "", ge=1, le=65535)
    secure: bool = value(False, "whether the server wants wss:// instead of ws://", "")
    states: States = Field(default_factory=States)
    commands: Commands


def open_driver(settings: Mapping[str, object], robot: Robot) -> RosbridgeDriver:
    """Return a driver that is not connected yet.

    Raises:
        UsageError: the settings are invalid.
    """
    read = read_settings(RosbridgeSettings, settings, "rosbridge", robot)
    order = read.commands.order
    if order and sorted(order) != sorted(read.joints):
        raise UsageError(
            f"driver rosbridge: commands.order: expected {', '.join(read.joints)}, in any order; got {', '.join(order)}",
            "look the order up where the controller is configured",
        )
    return RosbridgeDriver(read, robot.description.joints)


class RosbridgeDriver:
    """An arm behind a rosbridge server; see `Driver`.

    Args:
        settings: with the arm's names of its joints.
        names: what the robot file calls them, in the same order.
    """

    def __init__(self, settings: RosbridgeSettings, names: Sequence[str]) -> None:
        self._settings = settings
        self._reader = StateReader(settings.joints, tuple(names))
        self._ros: Any = None
        self._state: JointState | None = None
        self._failure: DriverError | None = None
        self._sent: Array | None = None
        self._held: Array | None = None  # what is commanded again and again
        self._told, self._closed, self._ending = threading.Event(), threading.Event(), threading.Event()
        self._hold_thread = threading.Thread(target=self._repeat_hold, name="rosbridge hold", daemon=True)

    def connect(self) -> None:
        """Connect to the bridge, and wait for a first reading; see `Driver`."""
        if self._ros is not None or self._ending.is_set():
            raise not_connected()
        where, timeout = self._settings, self._settings.timeout
        self._check_port()
        # roslibpy's other transport, Twisted, has one loop for the whole life of a process, which cannot begin anew
        self._ros = roslibpy.Ros(where.host, where.port, is_secure=where.secure, transport="asyncio")
        self._ros.factory.maxRetries = 0  # who lost an arm that moves must not find it again by itself
        self._ros.on("close", self._lose)
        try:
            self._ros.run(timeout)
        except roslibpy.core.RosTimeoutError:
            self.close()
            raise DriverError(
                f"{where.host}:{where.port} does not answer as a rosbridge server within {timeout:g} s",
                "is it rosbridge_server that listens there, and does `secure` fit it?",
            ) from None
        self._commands = roslibpy.Topic(self._ros, where.commands.topic, where.commands.type, queue_size=1)
        self._commands.advertise()
        # queue_length 1: the bridge drops what it cannot send in time, instead of sending old readings
        self._states = roslibpy.Topic(self._ros, where.states.topic, where.states.type, queue_length=1)
        self._states.subscribe(self._take)
        self._told.wait(timeout)
        try:
            self._newest()
        except DriverError:
            self.close()
            raise
        self._hold_thread.start()

    def read(self) -> JointState:
        """Return the newest reading; see `Driver`."""
        return self._newest()

    def command(self, target: Array) -> Array:
        """Publish a target (J,) rad; see `Driver`."""
        self._newest()
        sent = np.array(target, dtype=float)
        self._held, self._sent = None, sent
        self._publish(sent)
        return sent.copy()

    def hold(self) -> None:
        """Command the measured position, again and again until the next command or the end; see `Driver`."""
        state = self._state
        measured = state.position if state is not None and np.isfinite(state.position).all() else self._sent
        if self._ros is None or measured is None:
            return  # never moved by us
        if self._held is None:
            self._held = measured
        with suppress(Exception):
            self._publish(self._held)

    def close(self) -> None:
        """Hold, and end the connection; see `Driver`."""
        self._ending.set()
        if self._ros is None:
            return
        self.hold()
        ros, self._ros = self._ros, None
        if self._hold_thread.is_alive() and self._hold_thread is not threading.current_thread():
            self._hold_thread.join(END_TIMEOUT)
        with suppress(Exception):
            if ros.is_connected:
                ros.close(END_TIMEOUT)
                self._closed.wait(END_TIMEOUT)
        with suppress(Exception):
            ros.factory.manager.terminate()

    def _check_port(self) -> None:
        """Say at once why nobody answers: roslibpy itself tells only that time is up."""
        where = self._settings
        try:
            socket.create_connection((where.host, where.port), where.timeout).close()
        except OSError as error:
            raise DriverError(
                f"no rosbridge server at {where.host}:{where.port}: {error.strerror or error}",
                "start it, for example `roslaunch rosbridge_server rosbridge_websocket.launch`, and check `host` and `port`",
            ) from None

    def _newest(self) -> JointState:
        if self._ros is None:
            raise not_connected()
        if self._failure is not None:
            raise self._failure
        if self._state is None:
            raise DriverError(
                f"no joint states on {self._settings.states.topic} within {self._settings.timeout:g} s; {self._reader.seen}",
                "check `states.topic`, and `joints`, the arm's own names of its joints",
            )
        return self._state

    def _publish(self, target: Array) -> None:
        if self._closed.is_set():
            raise connection_lost()
        self._commands.publish(roslibpy.Message(command_message(self._settings, target)))

    def _take(self, message: Mapping[str, Any]) -> None:
        """Take a message; runs in roslibpy's thread, which swallows exceptions."""
        try:
            state = self._reader.read(message, time.monotonic())
        except DriverError as error:
            self._failure = self._failure or error
            self._told.set()
            return
        if state is not None:
            self._state = state
            self._told.set()

    def _lose(self, *_: object) -> None:
        self._failure = self._failure or connection_lost()
        self._closed.set()
        self._told.set()

    def _repeat_hold(self) -> None:
        while not self._ending.wait(HOLD_PERIOD):
            held = self._held
            if held is not None:
                with suppress(Exception):
                    self._publish(held)


class StateReader:
    """Reads messages of the type `sensor_msgs/JointState`.

    Args:
        joints: the arm's names, in the order of the readings.
        names: what readings call them.
    """

    def __init__(self, joints: Sequence[str], names: tuple[str, ...]) -> None:
        self._joints, self._names = tuple(joints), names
        self._clock, self._velocity = RemoteClock(), VelocityEstimator()
        self._others: set[str] = set()

    @property
    def seen(self) -> str:
        """Say which other joints messages had."""
        return f"messages named only {', '.join(sorted(self._others))}" if self._others else "there was no message at all"

    def read(self, message: Mapping[str, Any], arrived: float) -> JointState | None:
        """Return what a message tells, or None if it is about other joints, as of a gripper or a head.

        Args:
            message: as JSON.
            arrived: when it did, s of `time.monotonic`.

        Raises:
            DriverError: it lacks some joints, or is not as it should be.
        """
        told = message.get("name") if isinstance(message, Mapping) else None
        if not isinstance(told, list) or not all(isinstance(name, str) for name in told):
            raise malformed("a list of names in `name`", told)
        places = {name: place for place, name in enumerate(told)}
        missing = [name for name in self._joints if name not in places]
        if len(missing) == len(self._joints):
            self._others.update(told)
            return None
        if missing:
            raise DriverError(
                f"joint states lack {', '.join(missing)}; expected {', '.join(self._joints)}; got {', '.join(told)}",
                "name the joints in `joints` as the arm does, in the order of the robot file",
            )
        order = [places[name] for name in self._joints]
        position = numbers(message.get("position"), "position", len(told))[order]
        stamp = self._clock.local(header_seconds(message), arrived) if header_seconds(message) else arrived
        if message.get("velocity"):
            velocity = numbers(message["velocity"], "velocity", len(told))[order]
        else:  # a driver need not tell it
            velocity = self._velocity.update(stamp, position)
        return JointState(self._names, position, velocity, stamp)


def numbers(told: object, field: str, count: int) -> Array:
    """Return a list of `count` numbers as an array; null, as JSON has no NaN, becomes NaN.

    Raises:
        DriverError: it is no such list.
    """
    if not isinstance(told, list) or len(told) != count:
        raise malformed(f"{count} numbers in `{field}`, one for each name", told)
    if not all(number is None or (isinstance(number, int | float) and not isinstance(number, bool)) for number in told):
        raise malformed(f"numbers in `{field}`", told)
    return np.array([math.nan if number is None else float(number) for number in told])


def header_seconds(message: Mapping[str, Any]) -> float:
    """Return the stamp of a message's header, s on the arm's clock, as ROS 1 or 2 writes it; 0 if it has none."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if not isinstance(stamp, Mapping):
        return 0.0
    whole, rest = stamp.get("secs", stamp.get("sec", 0)), stamp.get("nsecs", stamp.get("nanosec", 0))
    if not isinstance(whole, int) or not isinstance(rest, int):
        raise malformed("whole numbers in `header.stamp`", stamp)
    return whole + rest * 1e-9


def command_message(settings: RosbridgeSettings, target: Array) -> dict[str, Any]:
    """Return the message that commands a target (J,) rad."""
    names, positions = list(settings.joints), [float(angle) for angle in target]
    kind = settings.commands.type.replace("/msg/", "/")
    if kind == "intera_core_msgs/JointCommand":
        # an empty header: the bridge fills in the time of its own clock
        return {"header": {}, "mode": POSITION_MODE, "names": names, "position": positions}
    if kind == "trajectory_msgs/JointTrajectory":
        whole, rest = divmod(round(settings.commands.seconds * 1e9), 1_000_000_000)
        # no header: its stamp is then zero, which means now; bridges of ROS 2 know these names of the fields too
        point = {"positions": positions, "time_from_start": {"secs": whole, "nsecs": rest}}
        return {"joint_names": names, "points": [point]}
    told = dict(zip(names, positions, strict=True))
    return {"data": [told[name] for name in settings.commands.order or names]}


def malformed(expected: str, got: object) -> DriverError:
    """Say that a message is not as it should be."""
    return DriverError(
        f"a joint state is malformed: expected {expected}, got {str(got)[:60]!r}",
        "is `states.topic` a topic of sensor_msgs/JointState?",
    )


def connection_lost() -> DriverError:
    """Say that the server has gone."""
    return DriverError("the connection to the rosbridge server is lost", "look at the server and the network, then start again")
