"""The driver `rosbridge`, against a rosbridge server over real websockets: commands as each message, and faults."""

from __future__ import annotations

import json
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("roslibpy")

from execution.conformance import DriverConformance, connected, fresh
from execution.drivers.failing import failure
from execution.drivers.rosbridge_server import RosbridgeServer

from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError
from skillcli.execution.drivers import rosbridge
from skillcli.execution.drivers.rosbridge import RosbridgeDriver, open_driver
from skillcli.robots.robot import load_robot

pytestmark = pytest.mark.real_time  # over websockets

JOINTS = tuple(f"right_j{number}" for number in range(7))
STATES, COMMANDS = "/robot/joint_states", "/robot/limb/right/joint_command"
SAWYER = "intera_core_msgs/JointCommand"
EXAMPLES = sorted(Path(rosbridge.__file__).parent.glob("rosbridge-*.toml"))


def settings(server: RosbridgeServer, **changed: Any) -> dict[str, Any]:
    commands = {"topic": server.commands, "type": server.kind}
    return {"port": server.port, "timeout": 2.0, "states": {"topic": server.states}, "commands": commands, **changed}


@pytest.fixture
def server() -> Iterator[RosbridgeServer]:
    server = RosbridgeServer(JOINTS, STATES, COMMANDS, SAWYER)
    yield server
    server.stop()


@pytest.fixture
def driver(server: RosbridgeServer) -> Iterator[RosbridgeDriver]:
    with closing(open_driver(settings(server), load_robot("sawyer"))) as driver:
        yield driver


def until(what: Callable[[], Any], seconds: float = 2.0) -> Any:
    end = time.monotonic() + seconds
    while not (got := what()) and time.monotonic() < end:
        time.sleep(0.005)
    return got


class TestSawyer(DriverConformance):
    names = JOINTS

    @pytest.fixture
    def driver(self, server: RosbridgeServer) -> Iterator[RosbridgeDriver]:  # type: ignore[override]
        yield open_driver(settings(server), load_robot("sawyer"))
        assert not server.troubles


@pytest.mark.parametrize(
    "kind",
    [
        "trajectory_msgs/JointTrajectory",
        "trajectory_msgs/msg/JointTrajectory",
        "std_msgs/Float64MultiArray",
        "std_msgs/msg/Float64MultiArray",
    ],
)
def test_every_type_of_command_moves_the_arm(kind: str) -> None:
    server = RosbridgeServer(JOINTS, "/joint_states", "/controller/command", kind)
    try:
        with connected(open_driver(settings(server), load_robot("sawyer"))) as driver:
            target = driver.read().position + 0.1
            assert driver.command(target) == pytest.approx(target)
            assert until(lambda: np.allclose(driver.read().position, target, atol=1e-3))
        assert not server.troubles
    finally:
        server.stop()


def test_a_list_without_names_is_sent_in_the_order_of_the_controller() -> None:
    server = RosbridgeServer(JOINTS[::-1], "/joint_states", "/controller/command", "std_msgs/Float64MultiArray")
    given = settings(server)
    given["commands"]["order"] = list(JOINTS[::-1])
    try:
        with connected(open_driver(given, load_robot("sawyer"))) as driver:
            target = driver.read().position + np.arange(7) * 0.01
            driver.command(target)
            assert until(lambda: np.allclose(driver.read().position, target, atol=1e-3))
    finally:
        server.stop()


def test_the_arms_own_names_are_mapped_to_those_of_the_robot_file() -> None:
    own = tuple(f"panda_joint{number}" for number in range(1, 8))
    server = RosbridgeServer(own, STATES, COMMANDS, "trajectory_msgs/JointTrajectory")
    try:
        with connected(open_driver(settings(server, joints=list(own)), load_robot("panda"))) as driver:
            state = driver.read()
            assert state.names == tuple(f"joint{number}" for number in range(1, 8))
            assert state.position == pytest.approx(server.arm.position)
            driver.command(state.position)
            assert until(lambda: server.received)[0][1]["joint_names"] == list(own)
    finally:
        server.stop()


def test_a_hold_commands_the_measured_position_until_the_next_command(driver: RosbridgeDriver, server: RosbridgeServer) -> None:
    driver.connect()
    far = driver.read().position + 1.0
    driver.command(far)
    time.sleep(0.03)
    driver.hold()
    held = np.array(until(lambda: len(server.received) > 4 and server.received)[-1][1]["position"])
    assert (held < far - 0.1).all()
    gaps = np.diff([at for at, _ in server.received[1:]])
    assert np.median(gaps) < 0.1, "a Sawyer forgets a command after 0.2 s"
    driver.hold()
    assert server.received[-1][1]["position"] == pytest.approx(held), "a hold does not creep along with a moving arm"
    driver.command(far)
    time.sleep(0.2)
    assert server.received[-1][1]["position"] == pytest.approx(far)


def test_a_message_that_waited_on_the_way_is_as_old_as_its_header_says(
    driver: RosbridgeDriver, server: RosbridgeServer
) -> None:
    driver.connect()
    assert time.monotonic() - driver.read().stamp < 0.1
    server.late = 0.5
    assert until(lambda: time.monotonic() - driver.read().stamp > 0.4)


def test_an_arm_that_falls_silent_is_seen_by_the_stamp(driver: RosbridgeDriver, server: RosbridgeServer) -> None:
    driver.connect()
    server.silent = True
    time.sleep(0.3)
    assert time.monotonic() - driver.read().stamp > 0.2


def test_a_message_that_is_no_json_is_skipped_and_seen_by_the_stamp(driver: RosbridgeDriver, server: RosbridgeServer) -> None:
    driver.connect()
    server.raw = '{"op": "publish", "topic": "'
    time.sleep(0.3)
    assert time.monotonic() - driver.read().stamp > 0.2
    server.raw = None
    assert fresh(driver, time.monotonic())


@pytest.mark.parametrize("told", [float("nan"), None])
def test_a_number_that_is_none_becomes_nan(driver: RosbridgeDriver, server: RosbridgeServer, told: float | None) -> None:
    driver.connect()
    server.alter = lambda message: {**message, "position": [told] * len(message["position"])}
    assert until(lambda: np.isnan(driver.read().position).all())
    driver.hold()  # with what was sent last: nothing
    assert not server.received


def test_velocities_that_are_not_told_are_estimated(driver: RosbridgeDriver, server: RosbridgeServer) -> None:
    server.alter = lambda message: {**message, "velocity": []}
    driver.connect()
    start = driver.read().position
    for step in range(1, 12):  # 0.4 rad/s
        driver.command(start + 0.02 * step)
        time.sleep(0.05)
    assert driver.read().velocity == pytest.approx(np.full(7, 0.4), abs=0.15)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"name": ["right_j0", "right_j1"], "position": [0.0, 0.0]}, "lack right_j2"),
        ({"position": [0.0]}, "expected 8 numbers in `position`"),
        ({"position": "all"}, "expected 8 numbers in `position`"),
        ({"position": ["1"] * 8}, "expected numbers in `position`"),
        ({"name": None}, "expected a list of names"),
        ({"header": {"stamp": {"secs": "now"}}}, "whole numbers in `header.stamp`"),
    ],
)
def test_a_malformed_message_ends_in_one_clear_line(
    driver: RosbridgeDriver, server: RosbridgeServer, changed: dict[str, Any], said: str
) -> None:
    driver.connect()
    target = driver.read().position
    server.alter = lambda message: {**message, **changed}
    error = failure(driver)
    assert said in error.message and "\n" not in error.message and error.hint
    with pytest.raises(DriverError, match=said[:10]):
        driver.command(target)
    driver.hold()
    assert until(lambda: server.received), "the arm can still be told to stay"


def test_a_connection_that_is_lost_in_the_middle_is_told_and_not_made_again(
    driver: RosbridgeDriver, server: RosbridgeServer
) -> None:
    driver.connect()
    target = driver.read().position
    server.drop()
    assert "is lost" in failure(driver).message
    with pytest.raises(DriverError, match="is lost"):
        driver.command(target)
    driver.hold()
    time.sleep(1.5)  # roslibpy would be back after a second
    assert not server.received and not server._subscribed


def test_nobody_there_is_told_at_once() -> None:
    given = {"port": 1, "commands": {"topic": COMMANDS, "type": SAWYER}}
    began = time.monotonic()
    with closing(open_driver(given, load_robot("sawyer"))) as driver:
        with pytest.raises(DriverError, match=r"no rosbridge server at 127\.0\.0\.1:1: .*refused") as told:
            driver.connect()
        driver.hold()
    assert time.monotonic() - began < 1 and "rosbridge_server" in told.value.hint


def test_who_listens_but_is_no_rosbridge_is_told() -> None:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as other:
        given = {"port": other.getsockname()[1], "timeout": 0.5, "commands": {"topic": COMMANDS, "type": SAWYER}}
        with pytest.raises(DriverError, match="does not answer as a rosbridge server"):
            open_driver(given, load_robot("sawyer")).connect()


def test_a_topic_without_messages_and_one_of_other_joints_are_told(server: RosbridgeServer) -> None:
    quiet = open_driver(settings(server, timeout=0.5, states={"topic": "/nothing"}), load_robot("sawyer"))
    with pytest.raises(DriverError, match=r"no joint states on /nothing within 0\.5 s; there was no message at all"):
        quiet.connect()
    other = open_driver(settings(server, timeout=0.5), load_robot("panda"))
    with pytest.raises(DriverError, match=r"named only head_pan, right_gripper, right_j0"):
        other.connect()


def test_threads_end_with_the_connection_and_another_can_be_made(server: RosbridgeServer) -> None:
    before = set(threading.enumerate())
    for _ in range(3):
        with connected(open_driver(settings(server), load_robot("sawyer"))) as driver:
            driver.command(driver.read().position)
    ours = [thread.name for thread in set(threading.enumerate()) - before if "ros" in thread.name]
    assert ours == [] and server.received


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"prot": 9090}, "prot: unknown"),
        ({"port": 0}, "port: expected at least 1, got 0"),
        ({"commands": {"topic": "/command"}}, "commands.type: missing"),
        (
            {"commands": {"topic": "/command", "type": "std_msgs/String"}},
            "commands.type: expected 'intera_core_msgs/JointCommand'",
        ),
        ({"commands": {"topic": "/c", "type": SAWYER, "order": ["right_j0"]}}, "commands.order: expected right_j0, right_j1"),
        ({"joints": ["a", "b"]}, "joints: expected 7 entries, one for each joint of 'sawyer', got 2"),
        ({"joints": ["a"] * 7}, "joints: expected different names"),
        ({"states": {"topic": ""}}, "states.topic: expected some text"),
    ],
)
def test_wrong_settings_are_refused(changed: dict[str, Any], said: str) -> None:
    given = {"commands": {"topic": COMMANDS, "type": SAWYER}, **changed}
    with pytest.raises(UsageError) as told:
        open_driver(given, load_robot("sawyer"))
    assert said in told.value.message and told.value.hint and "\n" not in told.value.message


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_fits_its_arm_and_the_page(path: Path) -> None:
    robot = {"rosbridge-sawyer": "sawyer", "rosbridge-trajectory": "ur5e"}[path.stem]
    text = path.read_text(encoding="utf-8")
    open_driver(tomllib.loads(text), load_robot(robot))
    page = Path(rosbridge.__file__).parents[3] / "docs" / "driver-rosbridge.md"
    indented = "".join(f"    {line}\n" if line else "\n" for line in text.splitlines())
    assert indented in page.read_text(encoding="utf-8")


def test_messages_are_what_ros_expects() -> None:
    read = open_driver({"commands": {"topic": "/c", "type": "trajectory_msgs/JointTrajectory"}}, load_robot("ur5e"))._settings
    message = rosbridge.command_message(read, np.arange(6.0))
    assert json.loads(json.dumps(message)) == {
        "joint_names": list(read.joints),
        "points": [{"positions": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "time_from_start": {"secs": 0, "nsecs": 100_000_000}}],
    }
