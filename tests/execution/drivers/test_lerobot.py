"""The driver `lerobot`: a robot of the tests' own, in every unit and with faults, and LeRobot's own classes where installed."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from execution.conformance import DriverConformance, connected
from execution.drivers.failing import failure

from skillcli.errors import UsageError
from skillcli.execution.driver import DriverError
from skillcli.execution.drivers.lerobot import LerobotDriver, open_driver
from skillcli.robots.robot import load_robot

pytestmark = pytest.mark.real_time

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
TAU = 0.03  # s
FACTORY = f"{__name__}:made"
MADE: list[FollowingRobot] = []


class FollowingRobot:
    """Looks like a LeRobot `Robot`, and follows its targets; positions are degrees of motors named as JOINTS, and a gripper."""

    def __init__(self, **arguments: Any) -> None:
        self.arguments = arguments
        self.position = dict(zip((*JOINTS, "gripper"), (1.0, -2.0, 10.0, 80.0, 3.0, 50.0), strict=True))
        self.target = dict(self.position)
        self.actions: list[dict[str, float]] = []
        self.is_connected = False
        self.is_calibrated = True
        self.connections = 0
        self.observed: Any = lambda observation: observation  # what becomes of it
        self.largest = float("inf")  # degrees per action, as LeRobot's `max_relative_target`
        self._moved = time.monotonic()
        self._busy = threading.Lock()

    def connect(self, calibrate: bool = True) -> None:
        assert not calibrate, "it would ask a person to move the arm"
        assert not self.is_connected
        self.is_connected = True
        self.connections += 1

    def get_observation(self) -> dict[str, Any]:
        with self._alone():
            self._move()
            observation = {f"{name}.pos": value for name, value in self.position.items()}
            return self.observed({"camera": np.zeros((2, 2, 3)), **observation})  # type: ignore[no-any-return]

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        with self._alone():
            self._move()
            sent = {}
            for key, wanted in action.items():
                here = self.position[key.removesuffix(".pos")]
                sent[key] = here + float(np.clip(wanted - here, -self.largest, self.largest))
                self.target[key.removesuffix(".pos")] = sent[key]
            self.actions.append(sent)
            return sent

    def disconnect(self) -> None:
        assert self.is_connected
        self.is_connected = False

    def _move(self) -> None:
        now = time.monotonic()
        share = -np.expm1((self._moved - now) / TAU)
        self.position = {name: here + (self.target[name] - here) * share for name, here in self.position.items()}
        self._moved = now

    @contextmanager
    def _alone(self) -> Iterator[None]:
        if not self.is_connected:
            raise ConnectionError("not connected")
        assert self._busy.acquire(blocking=False), "two callers at once: the bus of a real robot answers neither"
        try:
            yield
        finally:
            self._busy.release()


def made(**arguments: Any) -> FollowingRobot:
    MADE.append(FollowingRobot(**arguments))
    return MADE[-1]


def uncalibrated() -> FollowingRobot:
    robot = made()
    robot.is_calibrated = False
    return robot


def no_robot() -> object:
    return object()


def refusing() -> FollowingRobot:
    raise OSError("could not open port /dev/ttyACM0")


def hanging() -> FollowingRobot:
    time.sleep(30)
    return made()


def driver_of(**given: Any) -> LerobotDriver:
    return open_driver({"factory": FACTORY, **given}, load_robot("so101"))


@pytest.fixture
def driver() -> Iterator[LerobotDriver]:
    with closing(driver_of()) as driver:
        driver.connect()
        yield driver


@pytest.fixture
def robot(driver: LerobotDriver) -> FollowingRobot:
    return MADE[-1]


class TestLerobot(DriverConformance):
    names = JOINTS

    @pytest.fixture
    def driver(self) -> Iterator[LerobotDriver]:  # type: ignore[override]
        yield driver_of()


def test_angles_are_read_and_sent_in_degrees(driver: LerobotDriver, robot: FollowingRobot) -> None:
    assert driver.read().position == pytest.approx(np.deg2rad([1, -2, 10, 80, 3]))
    driver.command(np.deg2rad([2, -2, 10, 80, 3]))
    assert robot.actions[-1] == pytest.approx(
        {f"{name}.pos": value for name, value in zip(JOINTS, (2, -2, 10, 80, 3), strict=True)}
    )


def test_signs_zeros_and_other_names_are_translated() -> None:
    given = {"joints": list(JOINTS[::-1]), "signs": [-1, 1, 1, 1, 1], "zeros": [0.5, 0, 0, 0, 0]}
    with connected(driver_of(**given)) as driver:
        state = driver.read()
        assert state.names == JOINTS
        assert state.position == pytest.approx([0.5 - np.deg2rad(3), *np.deg2rad([80, 10, -2, 1])])
        sent = driver.command(state.position)
        assert sent == pytest.approx(state.position) and MADE[-1].actions[-1]["wrist_roll.pos"] == pytest.approx(3)


def test_radians_stay_as_they_are() -> None:
    with connected(driver_of(unit="radians")) as driver:
        assert driver.read().position == pytest.approx([1, -2, 10, 80, 3])


def test_normalised_units_span_the_ranges() -> None:
    with connected(driver_of(unit="normalised", ranges=[[-1, 1], [-2, 2], [0, 2], [0, 1], [-1, 1]])) as driver:
        assert driver.read().position == pytest.approx([0.01, -0.04, 1.1, 0.9, 0.03])
        driver.command(np.array([-1.0, 2.0, 0.0, 1.0, 0.0]))
        assert list(MADE[-1].actions[-1].values()) == pytest.approx([-100, 100, -100, 100, 0])


def test_normalised_units_span_the_joint_ranges_of_the_model() -> None:
    robot = load_robot("so101")
    with connected(driver_of(unit="normalised")) as driver:
        low, high = robot.model.joint(robot.names.joints[3]).range
        assert driver.read().position[3] == pytest.approx(low + 0.9 * (high - low))


def test_what_the_robot_made_of_a_command_is_returned(driver: LerobotDriver, robot: FollowingRobot) -> None:
    robot.largest = 5.0
    here = driver.read().position
    assert driver.command(here + 1.0) == pytest.approx(here + np.deg2rad(5.0))


def test_arguments_reach_the_factory_and_fixed_values_every_command() -> None:
    with connected(driver_of(arguments={"port": "/dev/ttyACM0", "use_degrees": True}, fixed={"gripper.pos": 0.0})) as driver:
        assert MADE[-1].arguments == {"port": "/dev/ttyACM0", "use_degrees": True}
        driver.command(driver.read().position)
        assert MADE[-1].actions[-1]["gripper.pos"] == 0.0


def test_the_velocity_is_that_of_the_last_readings(driver: LerobotDriver) -> None:
    start = driver.read().position
    for step in range(1, 12):
        driver.command(start + 0.02 * step)  # 0.4 rad/s
        time.sleep(0.05)
    assert driver.read().velocity == pytest.approx(np.full(5, 0.4), abs=0.15)


def test_a_hold_sends_the_measured_position(driver: LerobotDriver, robot: FollowingRobot) -> None:
    far = driver.read().position + 1.0
    driver.command(far)
    time.sleep(0.02)
    driver.hold()
    held = np.deg2rad([robot.actions[-1][f"{name}.pos"] for name in JOINTS])
    assert (held < far - 0.1).all()


def test_closing_disconnects_and_ends_the_thread(driver: LerobotDriver, robot: FollowingRobot) -> None:
    driver.close()
    assert not robot.is_connected and robot.connections == 1
    assert "arm readings" not in [thread.name for thread in threading.enumerate()]


@pytest.mark.parametrize(
    ("observed", "said"),
    [
        ({"shoulder_pan.pos": 1.0}, "get_observation() lacks shoulder_lift.pos"),
        (None, "get_observation() returned NoneType"),
        ({f"{name}.pos": "far" for name in JOINTS}, "get_observation() is malformed"),
    ],
)
def test_an_observation_that_is_none_ends_in_one_clear_line(
    driver: LerobotDriver, robot: FollowingRobot, observed: Any, said: str
) -> None:
    target = driver.read().position
    robot.observed = lambda _: observed
    error = failure(driver)
    assert said in error.message and "\n" not in error.message
    with pytest.raises(DriverError):
        driver.command(target)
    driver.hold()


def test_nan_is_read_as_nan_and_never_held(driver: LerobotDriver, robot: FollowingRobot) -> None:
    driver.command(driver.read().position)
    robot.observed = lambda observation: {key: float("nan") for key in observation}
    time.sleep(0.05)
    assert np.isnan(driver.read().position).all()
    driver.hold()
    assert np.isfinite(list(robot.actions[-1].values())).all()


def test_a_robot_that_is_unplugged_is_told(driver: LerobotDriver, robot: FollowingRobot) -> None:
    target = driver.read().position
    robot.is_connected = False
    assert failure(driver).message == "the arm no longer answers: ConnectionError: not connected"
    with pytest.raises(DriverError):
        driver.command(target)
    driver.hold()


def test_a_bus_that_hangs_delays_neither_reading_nor_holding(driver: LerobotDriver, robot: FollowingRobot) -> None:
    target = driver.read().position
    hanging = threading.Event()
    robot.observed = lambda observation: hanging.wait(2) and observation
    time.sleep(0.1)
    began = time.monotonic()
    stamp = driver.read().stamp
    driver.hold()
    assert time.monotonic() - began < 0.2 and began - stamp > 0.05
    with pytest.raises(DriverError, match=r"has not answered for 0\.1 s"):
        driver.command(target)
    hanging.set()


@pytest.mark.parametrize(
    ("factory", "said"),
    [
        ("no_such_module:made", "no_such_module cannot be imported: ModuleNotFoundError"),
        (f"{__name__}:missing", "has no function 'missing'"),
        (f"{__name__}:no_robot", "object has no connect, get_observation, send_action, disconnect, is_connected"),
        (f"{__name__}:uncalibrated", "the robot is not calibrated"),
        (f"{__name__}:refusing", "the robot cannot be connected: OSError: could not open port /dev/ttyACM0"),
        (f"{__name__}:hanging", "the robot is not connected within 0.2 s"),
        ("no_such_file.py:made", "no_such_file.py cannot be imported: FileNotFoundError"),
    ],
)
def test_a_factory_that_gives_no_robot_is_told(factory: str, said: str) -> None:
    with closing(driver_of(factory=factory, timeout=0.2)) as driver, pytest.raises(DriverError) as told:
        driver.connect()
    assert said in told.value.message and told.value.hint


def test_a_factory_may_stand_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "lerobot.py"
    path.write_text(f"from {__name__} import made\n", encoding="utf-8")
    with connected(driver_of(factory=f"{path}:made")) as driver:
        assert driver.read().names == JOINTS
    assert "lerobot" not in sys.modules or not str(sys.modules["lerobot"].__file__).startswith(str(tmp_path))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"factory": "made"}, "factory: expected"),
        ({"unit": "turns"}, "unit: expected 'degrees', 'radians' or 'normalised'"),
        ({"signs": [1, 1]}, "signs: expected 5 entries"),
        ({"signs": [1, 1, 1, 1, 0]}, "signs: expected 1 or -1"),
        ({"unit": "normalised", "zeros": [0.0] * 5}, "zeros: not with normalised units"),
        ({"rate": 0}, "rate: expected at least 1"),
        ({"port": "/dev/ttyACM0"}, "port: unknown"),
    ],
)
def test_wrong_settings_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError) as told:
        driver_of(**changed)
    assert said in told.value.message and told.value.hint and "\n" not in told.value.message


def own_so101() -> Any:
    """LeRobot's own class of the SO-101 on its own bus of Feetech servos, of which only the wire is replaced."""
    from lerobot.motors import MotorCalibration
    from lerobot.motors.feetech import FeetechMotorsBus
    from lerobot.robots.so_follower import SOFollower, SOFollowerRobotConfig

    class WirelessBus(FeetechMotorsBus):  # type: ignore[misc]
        is_connected = False
        is_calibrated = True

        def connect(self, handshake: bool = True) -> None:
            self.steps = dict.fromkeys(self.ids, 2048)  # of 4096 in a turn
            self.is_connected = True

        def disconnect(self, disable_torque: bool = True) -> None:
            self.is_connected = False

        @contextmanager
        def torque_disabled(self, motors: Any = None) -> Iterator[None]:
            yield

        def configure_motors(self, *_: Any, **__: Any) -> None:
            pass

        def write(self, *_: Any, **__: Any) -> None:
            pass

        def _sync_read(self, addr: int, length: int, motor_ids: list[int], **_: Any) -> tuple[dict[int, int], int]:
            return {motor: self.steps[motor] for motor in motor_ids}, 0

        def _sync_write(self, addr: int, length: int, ids_values: dict[int, int], **_: Any) -> int:
            self.steps.update(ids_values)
            return 0

    robot = SOFollower(SOFollowerRobotConfig(port="none", id="test", max_relative_target=20.0))
    calibration = {
        name: MotorCalibration(id=motor.id, drive_mode=0, homing_offset=0, range_min=1024, range_max=3072)
        for name, motor in robot.bus.motors.items()
    }
    robot.bus = WirelessBus("none", robot.bus.motors, calibration)
    MADE.append(robot)
    return robot


class TestLerobotsOwnSO101(DriverConformance):
    names = JOINTS

    @pytest.fixture
    def driver(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LerobotDriver]:  # type: ignore[override]
        monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path))  # where it looks for calibrations
        pytest.importorskip("lerobot.robots.so_follower")
        yield driver_of(factory=f"{__name__}:own_so101", timeout=60.0)

    def test_degrees_and_its_own_limit(self, driver: LerobotDriver) -> None:
        with connected(driver):
            assert driver.read().position == pytest.approx(np.zeros(5), abs=1e-3)
            sent = driver.command(np.deg2rad([10.0, 45.0, 0.0, 0.0, 0.0]))
            assert sent == pytest.approx(np.deg2rad([10.0, 20.0, 0.0, 0.0, 0.0]), abs=2e-3)
            assert MADE[-1].bus.steps[1] == pytest.approx(2048 + 10 / 360 * 4095, abs=1.5)
