"""A rosbridge v2 server with a tiny arm behind it, over real websockets on loopback.

It knows advertise, subscribe, publish and their opposites, and answers what is wrong with a `status`, as the real one does.
The arm follows its target with a time constant, and publishes its joints at 100 Hz. Faults are switched on by attributes.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import suppress
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

PERIOD = 0.01  # s
TAU = 0.03  # s, of the arm


class FollowingArm:
    """Joints that follow their targets."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self.position = np.linspace(-0.4, 0.4, len(names))
        self.velocity = np.zeros(len(names))
        self.target = self.position.copy()

    def step(self, seconds: float) -> None:
        before = self.position
        self.position = before + (self.target - before) * -np.expm1(-seconds / TAU)
        self.velocity = (self.position - before) / seconds


class RosbridgeServer:
    def __init__(self, names: tuple[str, ...], states: str, commands: str, kind: str) -> None:
        self.arm = FollowingArm(names)
        self.states, self.commands, self.kind = states, commands, kind
        self.received: list[tuple[float, dict[str, Any]]] = []  # commands, and when they came
        self.troubles: list[str] = []  # what a real server would complain about
        self.silent = False  # publishes nothing
        self.late = 0.0  # s, by which the header says messages were measured earlier
        self.alter: Any = lambda message: message  # what becomes of each joint state
        self.raw: str | None = None  # sent in place of a joint state
        self._subscribed: set[ServerConnection] = set()
        self._advertised: dict[str, str] = {}
        self._ending = threading.Event()
        # a connection that was cut answers no more: websockets would wait 10 s for that
        self._server = serve(self._talk, "127.0.0.1", 0, close_timeout=0.2)
        self.port: int = self._server.socket.getsockname()[1]
        for work in (self._server.serve_forever, self._simulate):
            threading.Thread(target=work, daemon=True).start()

    def drop(self) -> None:
        """Close every connection, in the middle."""
        for connection in list(self._subscribed):
            with suppress(OSError):  # a socket that is only closed leaves the thread that reads it waiting
                connection.socket.shutdown(socket.SHUT_RDWR)
            with suppress(Exception):
                connection.close()

    def stop(self) -> None:
        self._ending.set()
        self.drop()
        self._server.shutdown()

    def _talk(self, connection: ServerConnection) -> None:
        with suppress(ConnectionClosed, OSError):
            for text in connection:
                self._handle(json.loads(text), connection)
        self._subscribed.discard(connection)

    def _handle(self, message: dict[str, Any], connection: ServerConnection) -> None:
        topic = message.get("topic")
        match message["op"]:
            case "advertise":
                self._advertised[topic] = message["type"]
            case "unadvertise":
                self._advertised.pop(topic, None)
            case "subscribe" if topic == self.states:
                self._subscribed.add(connection)
            case "unsubscribe":
                self._subscribed.discard(connection)
            case "publish" if topic == self.commands and self._advertised.get(topic) == self.kind:
                self.received.append((time.monotonic(), message["msg"]))
                self.arm.target = self._target(message["msg"])
            case "subscribe":
                pass  # of a topic that nobody publishes on: a real bridge waits
            case other:
                self.troubles.append(f"{other} {topic}")
                connection.send(json.dumps({"op": "status", "level": "error", "msg": f"cannot {other} {topic}"}))

    def _target(self, message: dict[str, Any]) -> Any:
        if "data" in message:
            return np.array(message["data"])
        if "points" in message:
            assert "header" not in message, "a bridge would fill in the time, and the point would lie in the past"
            assert set(message["points"][0]["time_from_start"]) == {"secs", "nsecs"}
            names, positions = message["joint_names"], message["points"][0]["positions"]
        else:
            assert message["mode"] == 1 and message["header"] == {}
            names, positions = message["names"], message["position"]
        told = dict(zip(names, positions, strict=True))
        return np.array([told[name] for name in self.arm.names])

    def _simulate(self) -> None:
        """Step and publish; other joints stand in front, and of a gripper there are messages of its own."""
        due = time.monotonic()
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            due += PERIOD
            self.arm.step(PERIOD)
            if self.silent:
                continue
            now = time.time() - self.late
            stamp = {"secs": int(now), "nsecs": int((now % 1) * 1e9)}
            header = {"seq": 0, "stamp": stamp, "frame_id": ""}
            joints = {
                "header": header,
                "name": ["head_pan", *reversed(self.arm.names)],
                "position": [0.1, *self.arm.position[::-1].tolist()],
                "velocity": [0.0, *self.arm.velocity[::-1].tolist()],
                "effort": [],
            }
            gripper = {"header": header, "name": ["right_gripper"], "position": [0.02], "velocity": [], "effort": []}
            for message in (gripper, self.alter(joints)):
                self._send(self.raw or json.dumps({"op": "publish", "topic": self.states, "msg": message}))

    def _send(self, text: str) -> None:
        for connection in list(self._subscribed):
            with suppress(ConnectionClosed, OSError):
                connection.send(text)
