"""The driver `simulation`: our engine in a process of its own, in real time or faster, for any robot file and domain."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from skillcli.config.randomization import sample_each
from skillcli.execution.driver import DriverError, JointState, ObjectPose
from skillcli.execution.drivers.settings import validated
from skillcli.execution.simulation import wire
from skillcli.execution.simulation.faults import Conditions
from skillcli.execution.simulation.wire import Inbox, Kind, Outbox, Reading
from skillcli.recipe import load_recipe
from skillcli.robots.robot import Robot
from skillcli.seeding import generator
from skillcli.simulation.domains import find_domain
from skillcli.trajectories import Array

START_SECONDS = 60.0  # s, within which the process of the arm must have begun
LOST = 0.8  # control periods after which a command must have been taken
GONE_SECONDS = 0.002  # s, to ask a process that is gone for its code: the caller has a hold to send
END_SECONDS = 2.0  # s, that the process may take to end


class Settings(Conditions):
    """Settings of the driver; those of `Conditions` too."""

    # by name, or as an artifact holds it: the task, and the arm of its skills
    recipe: Annotated[dict[str, Any], BeforeValidator(lambda given: _recipe(given)), Field(validate_default=True)] = "reach"  # type: ignore[assignment]
    domain: str = "nominal"  # a preset or a file: every episode has a robot drawn from it
    speed: Annotated[float, Field(gt=0, le=100)] = 1.0  # simulated seconds in a second
    # s, how much longer than with a real arm readings and the loop may take, on a machine that is busy with other work
    patience: Annotated[float, Field(ge=0, le=10)] = 0.0
    seed: Annotated[int, Field(ge=0)] = 0  # of the drawn robots: as `skill transfer-eval --seed`


def _recipe(given: object) -> object:
    return load_recipe(given).model_dump(mode="json") if isinstance(given, str) else given


def open_driver(settings: Mapping[str, object], robot: Robot) -> SimulationDriver:
    """Return a driver of a simulated arm.

    Raises:
        UsageError: a setting is wrong, or the domain is unknown.
    """
    return SimulationDriver(validated(Settings, settings, "simulation", "docs/execute.md"), robot)


class SimulationDriver:
    """A simulated arm; it sees the object too, if its task has one, and can be put back to the start.

    Args:
        settings: see `Settings`.
        robot: the arm to simulate.
    """

    def __init__(self, settings: Settings, robot: Robot) -> None:
        self._settings, self._robot = settings, robot
        self._domain = find_domain(settings.domain)
        self._period = float(settings.recipe["task"]["control_period"]) / settings.speed  # s, of the machine's clock
        self._process: subprocess.Popen[bytes] | None = None
        self._end: socket.socket | None = None
        self._names: tuple[str, ...] = ()
        self._reading: Reading | None = None
        self._sent, self._sent_at = 0, 0.0  # number of the last command, and when it was sent
        self._reset_at = 0.0
        self._trouble = ""  # why the arm's process ended

    @property
    def speed(self) -> float:
        """See `Resettable`."""
        return self._settings.speed

    @property
    def patience(self) -> float:
        """See `Resettable`."""
        return self._settings.patience

    def connect(self) -> None:
        """See `Driver`."""
        ours, theirs = socket.socketpair()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        command = [sys.executable, "-m", "skillcli.execution.simulation.server", str(theirs.fileno())]
        # in a session of its own: a Ctrl-C in the terminal is for us, who then hold the arm
        self._process = subprocess.Popen(
            command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=self._errors,
            start_new_session=True,
        )  # fmt: skip
        theirs.close()
        ours.setblocking(False)
        self._end, self._inbox, self._outbox = ours, Inbox(ours), Outbox(ours)
        setup = {
            "recipe": self._settings.recipe,
            "robot": self._robot.which,
            "delay": "latency" in self._domain.parameters,
            "speed": self.speed,
            "seed": self._settings.seed,
            "conditions": self._settings.model_dump(mode="json", include=set(Conditions.model_fields)),
        }
        self._tell(wire.packed_json(Kind.SETUP, setup))
        self._wait(lambda: bool(self._names), START_SECONDS)
        self.reset(0)

    def reset(self, episode: int) -> None:
        """Put arm and object back to the start, as the robot that `transfer-eval` draws for this episode.

        Raises:
            DriverError: the connection is lost.
        """
        use, seed = self._domain.name, self._settings.seed
        drawn = sample_each(self._domain.parameters, [generator(seed, f"domain {use} {episode}")], self._robot.joint_count)
        parameters = {name: values.tolist() for name, values in drawn.items()}
        self._reset_at, self._sent = time.monotonic(), 0
        self._tell(wire.packed_json(Kind.RESET, {"parameters": parameters, "seed": seed, "use": f"sensors {use} {episode}"}))
        self._wait(lambda: self._reading is not None and self._reading.stamp > self._reset_at, START_SECONDS)

    def read(self) -> JointState:
        """See `Driver`."""
        self._take()
        reading = self._known()
        if self._sent and reading.taken < self._sent and reading.stamp - self._sent_at > LOST * self._period + self.patience:
            raise DriverError("the simulated arm did not get the last command", "a command was lost on the way")
        return JointState(self._names, reading.position, reading.velocity, reading.stamp)

    def object_pose(self) -> ObjectPose:
        """See `ObjectSource`; taken together with the joints of the last `read`.

        Raises:
            DriverError: the task has no object.
        """
        reading = self._known()
        if reading.pose is None:
            raise DriverError("this task has no object to see", "")
        return ObjectPose(reading.pose, reading.stamp)

    def command(self, target: Array) -> Array:
        """See `Driver`."""
        self._known()
        self._sent, self._sent_at = self._sent + 1, time.monotonic()
        self._tell(wire.packed_command(self._sent, target))
        return np.array(target, dtype=float)

    def hold(self) -> None:
        """See `Driver`."""
        if self._end is not None:
            self._sent = 0  # nothing is expected to be taken any more
            with suppress(OSError):  # there is nobody to tell: without its process the arm is gone
                self._outbox.send(wire.packed(Kind.HOLD), must=True)

    def close(self) -> None:
        """See `Driver`."""
        self.hold()
        if self._end is not None:
            self._end.close()
            self._end = None
        if self._process is not None:
            try:
                self._process.wait(END_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._errors.close()
            self._process = None
        self._reading = None

    def _known(self) -> Reading:
        if self._end is None or self._reading is None:
            raise DriverError("the simulated arm is not connected", "connect first")
        return self._reading

    def _tell(self, message: bytes) -> None:
        try:
            self._outbox.send(message, must=True)
        except OSError:
            raise self._lost() from None

    def _take(self) -> None:
        """Take all messages that have arrived; the last reading counts."""
        if self._end is None:
            return
        try:
            for kind, body in self._inbox.take():
                if kind is Kind.READING:
                    self._reading = wire.read_reading(body, len(self._names))
                elif kind in (Kind.READY, Kind.NAMES):
                    self._names = tuple(json.loads(body)["names"])
                elif kind is Kind.TROUBLE:
                    self._trouble = str(json.loads(body)["reason"])
        except OSError:
            raise self._lost() from None

    def _wait(self, done: Any, seconds: float) -> None:
        until = time.monotonic() + seconds
        while not done():
            self._take()
            self._outbox.flush()
            if time.monotonic() > until:
                raise DriverError(f"the simulated arm does not answer within {seconds:g} s", "is the machine very busy?")
            time.sleep(0.0005)

    def _lost(self) -> DriverError:
        """Say why the process of the arm is gone."""
        assert self._process is not None
        reason = self._trouble
        if not reason:
            try:
                code: object = self._process.wait(GONE_SECONDS)
            except subprocess.TimeoutExpired:
                code = "unknown"
            self._errors.seek(0)
            told = self._errors.read().decode(errors="replace").strip().splitlines()
            reason = f"its process ended with code {code}" + (f": {told[-1]}" if told else "")
        return DriverError(f"the simulated arm no longer answers: {reason}", "start again")
