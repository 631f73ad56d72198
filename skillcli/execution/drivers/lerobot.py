"""Any robot of LeRobot, or anything that looks like one: its `get_observation` and `send_action`, in our angles."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from skillcli.config.base import value
from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError, JointState
from skillcli.execution.drivers.readings import PolledDriver, VelocityEstimator, lost, not_connected
from skillcli.execution.drivers.settings import NamedSettings, check_length, read_settings
from skillcli.paths import expanded
from skillcli.robots.posture import joint_ranges
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array

POSITION = ".pos"  # what LeRobot puts behind the name of a joint
BUSY = 0.1  # s, that a command waits for a reading which is under way on the same bus
ROBOT_HINT = "what the robot returns has to be as LeRobot's"
METHODS = ("connect", "get_observation", "send_action", "disconnect")  # of a robot
FULL_SCALE = 100.0  # LeRobot's normalised units go from minus this to this

Unit = Literal["degrees", "radians", "normalised"]
Range = tuple[float, float]


class LerobotSettings(NamedSettings):
    """Settings of the driver; docs/driver-lerobot.md explains them."""

    factory: str = value(
        ..., 'what returns the robot: "package.module:function" or "file.py:function"', "", pattern=r"^.+:\w+$"
    )
    arguments: dict[str, str | int | float | bool] = value({}, "given to it, by keyword", "")
    unit: Unit = value("degrees", "of the robot's positions", "")
    signs: tuple[int, ...] = value((), "1, or -1 where a joint turns the other way than in the robot file", "")
    zeros: tuple[float, ...] = value((), "our angle where the robot says zero", "rad")
    ranges: tuple[Range, ...] = value(
        (), "our angles at -100 and 100 of normalised units; the joints' ranges, if left out", "rad"
    )
    fixed: dict[str, float] = value({}, "sent with every command, in the robot's own units, such as of a gripper", "")
    rate: float = value(100.0, "readings in a second, at most", "Hz", ge=1, le=1000)


class LerobotLike(Protocol):
    """What the driver uses of a robot."""

    @property
    def is_connected(self) -> bool:
        """Return whether it is."""

    def connect(self) -> None:
        """Open the connection. It may take `calibrate`, and then gets False: calibrating asks a person to move the arm."""

    def get_observation(self) -> Mapping[str, Any]:
        """Return `NAME.pos` of every joint, and other things."""

    def send_action(self, action: dict[str, Any]) -> Mapping[str, Any]:
        """Send `NAME.pos` of some joints; return what was sent, after the robot's own limits."""

    def disconnect(self) -> None:
        """End the connection."""


def open_driver(settings: Mapping[str, object], robot: Robot) -> LerobotDriver:
    """Return a driver that is not connected yet; the robot is made when it connects.

    Raises:
        UsageError: the settings are invalid.
    """
    read = read_settings(LerobotSettings, settings, "lerobot", robot)
    for key in ("signs", "zeros", "ranges"):
        if given := getattr(read, key):
            check_length(key, given, "lerobot", robot)
    if any(sign not in (-1, 1) for sign in read.signs):
        raise UsageError(
            f"driver lerobot: signs: expected 1 or -1 for each joint, got {list(read.signs)}", "see docs/driver-lerobot.md"
        )
    return LerobotDriver(read, robot.description.joints, Scale.of(read, robot))


class Scale:
    """Translates between the robot's numbers and our angles: angle = zero + factor x number.

    Args:
        factor: (J,) rad for one of the robot's units, negative where it turns the other way.
        zero: (J,) rad, our angle where the robot says zero.
    """

    def __init__(self, factor: Array, zero: Array) -> None:
        self._factor, self._zero = factor, zero

    @staticmethod
    def of(settings: LerobotSettings, robot: Robot) -> Scale:
        """Return the scale that settings ask for.

        Raises:
            UsageError: normalised units of a joint whose range is not known, or both ways to say where zero is.
        """
        count = robot.joint_count
        signs, zeros = np.array(settings.signs or (1,) * count, dtype=float), np.array(settings.zeros or (0.0,) * count)
        if settings.unit == "radians":
            return Scale(signs, zeros)
        if settings.unit == "degrees":
            return Scale(signs * math.pi / 180, zeros)
        if settings.zeros:
            raise UsageError(
                "driver lerobot: zeros: not with normalised units, whose zero is the middle", "give `ranges` instead"
            )
        low, high = np.array(settings.ranges or _joint_ranges(robot), dtype=float).T
        return Scale(signs * (high - low) / (2 * FULL_SCALE), (low + high) / 2)

    def to_angles(self, numbers: Array) -> Array:
        """Return the angles (J,) rad of the robot's numbers (J,)."""
        return np.asarray(self._zero + self._factor * numbers)

    def to_numbers(self, angles: Array) -> Array:
        """Return the robot's numbers (J,) of angles (J,) rad."""
        return np.asarray((angles - self._zero) / self._factor)


class LerobotDriver(PolledDriver):
    """A robot of LeRobot; see `Driver`.

    Its bus takes one caller at a time: a thread asks for readings, and a command waits until the question is answered.

    Args:
        settings: with the robot's names of its joints.
        names: what the robot file calls them, in the same order.
        scale: of the robot's positions.
    """

    def __init__(self, settings: LerobotSettings, names: Sequence[str], scale: Scale) -> None:
        super().__init__(1 / settings.rate, settings.timeout)
        self._settings, self._names, self._scale = settings, tuple(names), scale
        self._keys = [name + POSITION for name in settings.joints]
        self._velocity = VelocityEstimator()
        self._bus = threading.Lock()
        self._sent: Array | None = None

    def command(self, target: Array) -> Array:
        """Send a target (J,) rad; return what the robot made of it, (J,) rad; see `Driver`."""
        self.read()  # raises what the robot last raised
        return self._send(np.array(target, dtype=float), BUSY)

    def hold(self) -> None:
        """Send the measured position; see `Driver`."""
        with suppress(Exception):
            assert self._poller is not None
            try:
                position = self._poller.newest().position
            except DriverError:
                position = np.full(len(self._names), math.nan)
            held = position if np.isfinite(position).all() else self._sent
            if held is not None:
                self._send(held, BUSY)

    def close(self) -> None:
        """Hold, and disconnect; many robots then switch their motors off; see `Driver`."""
        robot, poller = self._robot, self._poller
        if robot is None or poller is None:
            return
        self.hold()
        poller.stop(self._settings.timeout)
        self._robot = self._poller = None
        with suppress(Exception):
            if robot.is_connected:
                robot.disconnect()

    def _unanswered(self) -> DriverError:
        return DriverError(
            f"the robot is not connected within {self._settings.timeout:g} s", "is it switched on, and does it ask something?"
        )

    def _refused(self, error: Exception) -> DriverError:
        return DriverError(f"the robot cannot be connected: {type(error).__name__}: {error}", "try it with LeRobot itself")

    def _made(self) -> LerobotLike:
        """Make the robot and connect to it, without calibrating."""
        robot: Any = _factory(self._settings.factory)(**self._settings.arguments)
        missing = [name for name in METHODS if not callable(getattr(robot, name, None))]
        missing += [] if hasattr(robot, "is_connected") else ["is_connected"]
        if missing:
            raise DriverError(
                f"{self._settings.factory} returned no robot: {type(robot).__name__} has no {', '.join(missing)}",
                "return an object of a class derived from LeRobot's Robot",
            )
        if not robot.is_connected:
            calibrates = "calibrate" in inspect.signature(robot.connect).parameters
            robot.connect(calibrate=False) if calibrates else robot.connect()
        if not getattr(robot, "is_calibrated", True):
            robot.disconnect()
            raise DriverError("the robot is not calibrated", "calibrate it with LeRobot first: lerobot-calibrate")
        return robot  # type: ignore[no-any-return]

    def _measure(self) -> JointState:
        with self._bus:
            observation = self._robot.get_observation()
            stamp = time.monotonic()  # after the answer: the bus may have been slow to ask
        position = self._scale.to_angles(self._numbers(observation, "get_observation()"))
        return JointState(self._names, position, self._velocity.update(stamp, position), stamp)

    def _send(self, target: Array, patience: float) -> Array:
        robot = self._robot
        if robot is None:
            raise not_connected()
        numbers = self._scale.to_numbers(target)
        action = {**self._settings.fixed, **dict(zip(self._keys, map(float, numbers), strict=True))}
        if not self._bus.acquire(timeout=patience):
            raise DriverError(
                f"the robot has not answered for {patience:g} s", "look at its cable and its power, then start again"
            )
        try:
            sent = robot.send_action(action)
        except Exception as error:
            raise lost(error) from None
        finally:
            self._bus.release()
        self._sent = target
        return self._scale.to_angles(self._numbers(sent, "send_action()"))

    def _numbers(self, told: object, what: str) -> Array:
        """Return the joints' numbers (J,) of what the robot told."""
        if not isinstance(told, Mapping):
            raise DriverError(
                f"{what} returned {type(told).__name__}; expected a dict with {', '.join(self._keys)}", ROBOT_HINT
            )
        if missing := [key for key in self._keys if key not in told]:
            raise DriverError(
                f"{what} lacks {', '.join(missing)}; expected {', '.join(self._keys)}; got {', '.join(map(str, told))}",
                "name the joints in `joints` as the robot does, in the order of the robot file",
            )
        try:
            return np.array([float(told[key]) for key in self._keys])
        except (TypeError, ValueError):
            got = ", ".join(f"{key} = {told[key]!r:.20}" for key in self._keys)
            raise DriverError(f"{what} is malformed: expected a number for each joint, got {got}", ROBOT_HINT) from None


def _joint_ranges(robot: Robot) -> Array:
    """Return the joints' ranges in the model, (J, 2) rad.

    Raises:
        UsageError: a joint has none.
    """
    ranges = joint_ranges(robot.model, robot.names.joints)
    if (free := ~np.isfinite(ranges).all(axis=1)).any():
        name = robot.description.joints[int(np.argmax(free))]
        raise UsageError(f"driver lerobot: ranges: joint {name!r} has no range in the model", "give `ranges`, for every joint")
    return ranges


def _factory(text: str) -> Any:
    """Return the function that a text names.

    Raises:
        DriverError: there is none.
    """
    where, _, name = text.rpartition(":")
    try:
        module = _module(where)
    except Exception as error:
        raise DriverError(
            f"{where} cannot be imported: {type(error).__name__}: {error}",
            "`factory` is package.module:function or file.py:function; is LeRobot installed here?",
        ) from None
    found = getattr(module, name, None)
    if not callable(found):
        functions = [known for known, thing in vars(module).items() if callable(thing) and not known.startswith("_")]
        raise DriverError(f"{where} has no function {name!r}", f"it has: {', '.join(functions) or 'none'}")
    return found


def _module(where: str) -> Any:
    if not where.endswith(".py"):
        return importlib.import_module(where)
    path: Path = expanded(where)
    name = f"skill_lerobot_{path.stem}"  # a file called lerobot.py must not stand in for the package
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError("it is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up their module
    spec.loader.exec_module(module)
    return module
