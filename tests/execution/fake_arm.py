"""An arm without physics: it follows its target with a time constant, and breaks as a test says."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from skillcli.execution.driver import DriverError, JointState
from skillcli.trajectories import Array

LAG = 0.03  # s


class FakeArm:
    """A driver; `change` makes a reading of the true one and the number of commands so far, or raises."""

    def __init__(
        self, names: tuple[str, ...], start: Array, change: Callable[[JointState, int], JointState] = lambda state, _: state
    ) -> None:
        self.names, self.position, self.change = names, np.array(start, dtype=float), change
        self.target, self.since = self.position.copy(), time.monotonic()
        self.commands: list[Array] = []
        self.held: list[float] = []  # when it was told to hold
        self.connected = False

    def connect(self) -> None:
        self.connected = True

    def read(self) -> JointState:
        self._move()
        state = JointState(self.names, self.position.copy(), np.zeros(len(self.names)), self.since)
        return self.change(state, len(self.commands))

    def command(self, target: Array) -> Array:
        if not self.connected:
            raise DriverError("not connected")
        self.commands.append(target.copy())
        self._move()
        self.target = target.copy()
        return target

    def _move(self) -> None:
        now = time.monotonic()
        self.position = self.target + np.exp((self.since - now) / LAG) * (self.position - self.target)
        self.since = now

    def hold(self) -> None:
        self.held.append(time.monotonic())

    def close(self) -> None:
        self.hold()
        self.connected = False
