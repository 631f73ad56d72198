"""The process of a simulated arm: `python -m skillcli.execution.simulation.server FD`, one end of a pair of sockets.

It lets simulated time pass as the clock of the machine does, times a factor, tells after every cycle what it measures, and
takes targets. It ends when the other end closes.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import sys
import time
from collections import deque
from typing import Any

import numpy as np

from skillcli.errors import SkillError
from skillcli.execution.clock import urgent
from skillcli.execution.simulation import wire
from skillcli.execution.simulation.arm import SimulatedArm
from skillcli.execution.simulation.faults import Conditions
from skillcli.execution.simulation.wire import Inbox, Kind, Outbox, Reading
from skillcli.recipe import resolve
from skillcli.robots.robot import load_target
from skillcli.seeding import generator
from skillcli.tasks.world import World
from skillcli.trajectories import Array

MOST_CYCLES = 500  # passed at once, after the machine was busy elsewhere
JUMP = 60.0  # s, by which stamps jump


def world_of(setup: dict[str, Any]) -> World:
    """Return the task on the robot that is to be simulated."""
    recipe = resolve(setup["recipe"])
    world = World.of(recipe)
    return world if setup["robot"] in ("", recipe.robot) else world.on(load_target(setup["robot"], world.robot))


class Server:
    """Serves one client until it leaves.

    Args:
        end: our end of the pair.
        setup: what the client asked for.
    """

    def __init__(self, end: socket.socket, setup: dict[str, Any], inbox: Inbox) -> None:
        self._inbox, self._outbox, self._end = inbox, Outbox(end), end
        world = world_of(setup)
        self._arm = SimulatedArm(world, bool(setup["delay"]))
        self._speed = float(setup["speed"])
        self._conditions = Conditions.model_validate(setup["conditions"])
        self._rng = generator(int(setup["seed"]), "messages")
        self._names = list(world.robot.description.joints)
        self._told = self._names  # as they were told last
        self._coming: deque[tuple[float, int, Array]] = deque()  # commands under way: when they arrive, number, target
        self._going: deque[tuple[float, bytes]] = deque()  # readings under way
        self._last: Reading | None = None  # told last
        self._restart()

    def _restart(self) -> None:
        """Let simulated time begin now."""
        self._zero, self._cycles, self._taken = time.monotonic(), 0, 0
        self._first = math.inf  # s of simulated time, when the first command came
        self._coming.clear()

    @property
    def _now(self) -> float:
        """Return the simulated time, s."""
        return self._cycles * self._arm.cycle

    def serve(self) -> None:
        """Serve until the other end closes."""
        self._outbox.send(wire.packed_json(Kind.READY, {"names": self._names, "cycle": self._arm.cycle}), must=True)
        while True:
            due = self._zero + (self._cycles + 1) * self._arm.cycle / self._speed
            wait = max(0.0, min(due, *(when for when, _ in self._going), math.inf) - time.monotonic())
            select.select([self._end], [], [], wait)
            self._pass_time()
            for kind, body in self._inbox.take():
                self._pass_time()
                self._answer(kind, body)
            self._deliver()

    def _answer(self, kind: Kind, body: bytes) -> None:
        if kind is Kind.COMMAND:
            number, target = wire.read_command(body)
            self._first = min(self._first, self._now)
            lost = "drop" in self._acting()
            travels = math.inf if lost else self._conditions.delay(self._rng)
            if travels == 0.0:
                self._take(number, target)
            elif math.isfinite(travels):
                self._coming.append((self._now + travels, number, target))
        elif kind is Kind.HOLD:
            self._coming.clear()
            self._arm.hold()
        elif kind is Kind.RESET:
            asked = json.loads(body)
            parameters = {name: np.array(values) for name, values in asked["parameters"].items()}
            self._arm.reset(parameters, generator(asked["seed"], asked["use"]))
            self._restart()

    def _take(self, number: int, target: Array) -> None:
        self._taken = number
        self._arm.command(target)

    def _pass_time(self) -> None:
        """Let the cycles pass that are over by now, and tell what is measured at the end of the last."""
        due = int((time.monotonic() - self._zero) * self._speed / self._arm.cycle + 1e-9)
        passing = min(due - self._cycles, MOST_CYCLES)
        for _ in range(passing):
            while self._coming and self._coming[0][0] <= self._now:
                self._take(*self._coming.popleft()[1:])
            self._arm.advance()
            self._cycles += 1
        if passing <= 0:
            return
        if self._arm.diverged():
            self._outbox.send(wire.packed_json(Kind.TROUBLE, {"reason": "the simulation has diverged"}), must=True)
            raise SystemExit(1)
        if self._cycles < due:  # it was late by more than it may catch up: time starts anew here
            self._zero += (due - self._cycles) * self._arm.cycle / self._speed
        self._tell()

    def _acting(self) -> set[str]:
        return self._conditions.acting(self._now - self._first) if math.isfinite(self._first) else set()

    def _tell(self) -> None:
        """Send a reading on its way, as the faults leave it."""
        acting = self._acting()
        if "kill" in acting:
            os._exit(9)
        position, velocity, pose = self._arm.read()
        stamp = self._zero + self._now / self._speed
        reading = Reading(stamp, self._taken, position, velocity, pose)
        if "stall" in acting and self._last is not None:
            reading = self._last._replace(taken=self._taken)
        elif "freeze" in acting and self._last is not None:
            reading = self._last._replace(taken=self._taken, stamp=stamp)
        self._last = reading
        names = self._names
        if "nan" in acting:
            reading = reading._replace(position=np.concatenate([[np.nan], reading.position[1:]]))
        if "swap" in acting:
            order = [1, 0, *range(2, len(names))]
            reading = reading._replace(position=reading.position[order], velocity=reading.velocity[order])
            names = [names[joint] for joint in order]
        if "clock" in acting:
            reading = reading._replace(stamp=stamp + JUMP)
        if "back" in acting:
            reading = reading._replace(stamp=stamp - JUMP)
        travels = math.inf if "gap" in acting else self._conditions.delay(self._rng)
        if not math.isfinite(travels):
            return
        message = wire.packed_reading(reading)
        if names != self._told:
            message, self._told = wire.packed_json(Kind.NAMES, {"names": names}) + message, names
        self._going.append((time.monotonic() + travels / self._speed, message))

    def _deliver(self) -> None:
        """Hand over the readings that have arrived; none overtakes another."""
        now = time.monotonic()
        while self._going and self._going[0][0] <= now:
            self._outbox.send(self._going.popleft()[1])
        self._outbox.flush()


def main() -> None:
    """Serve the client at the other end of the socket whose number is the first argument."""
    end = socket.socket(fileno=int(sys.argv[1]))
    inbox, outbox = Inbox(end), Outbox(end)
    (kind, body), *_ = _first_message(inbox, end)
    assert kind is Kind.SETUP
    end.setblocking(False)
    try:
        with urgent():  # the controller of an arm is not put aside for other work either
            Server(end, json.loads(body), inbox).serve()
    except ConnectionError:
        return  # the client has left
    except SkillError as error:
        outbox.send(wire.packed_json(Kind.TROUBLE, {"reason": error.message, "hint": error.hint}), must=True)
        raise SystemExit(1) from None


def _first_message(inbox: Inbox, end: socket.socket) -> list[tuple[Kind, bytes]]:
    end.setblocking(False)
    while True:
        select.select([end], [], [])
        messages = list(inbox.take())
        if messages:
            return messages


if __name__ == "__main__":
    main()
