"""Robot files for models that have none."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from skillcli.errors import UsageError
from skillcli.robots.config import bundled_file
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.new_file import NewRobot, propose_robot
from skillcli.robots.robot import load_robot
from skillcli.robots.start import POINTS_DOWN
from skillcli.robots.tuning import propose_gains, step_responses

HERE = Path(__file__).parent
PENDULUMS = """<mujoco><worldbody><body name="base">{arms}</body></worldbody></mujoco>"""
LINK = """<body name="{name}{i}" pos="0 0 .2"><joint name="{name}j{i}" axis="{axis}" range="-2.5 2.5" limited="true"/>
<geom type="capsule" fromto="0 0 0 0 0 .2" size=".03" mass="1"/>{inner}</body>"""


def links(name: str, count: int, inner: str = "") -> str:
    """A chain of hinges, each link standing on the one before."""
    for i in reversed(range(count)):
        inner = LINK.format(name=name, i=i, axis="0 0 1" if i in (0, count - 1) else "0 1 0", inner=inner)
    return inner


def model(tmp_path: Path, arms: str) -> str:
    path = tmp_path / "model.xml"
    path.write_text(PENDULUMS.format(arms=arms), encoding="utf-8")
    return str(path)


def loaded(found: NewRobot, file: Path) -> dict[str, object]:
    """What a written file says, after seeing that it loads and that the arm points down at its start."""
    file.write_text(found.text, encoding="utf-8")
    robot = load_robot(file)
    kinematics = Kinematics(robot)
    _, axis = kinematics.gripper(np.array(robot.home))
    assert axis[2] < -POINTS_DOWN and not kinematics.collides(np.array(robot.home))
    assert all(response.good for response in step_responses(robot, np.array(robot.home)))
    return tomllib.loads(found.text)


def test_motors_get_gains_and_the_frame_of_the_hand_is_found(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    found = propose_robot(str(HERE / "torque.xml"), file)
    assert found.joints == ("base_yaw", "shoulder", "upper_roll", "elbow", "fore_roll", "wrist", "hand_roll")
    said = loaded(found, file)
    given = load_robot(HERE / "torque.toml")
    at, _ = Kinematics(given).gripper(np.array(load_robot(file).home))
    ours, _ = Kinematics(load_robot(file)).gripper(np.array(load_robot(file).home))
    assert ours == pytest.approx(at, abs=0.03), "where a person mounted the finger"
    assert set(said["gains"]) == {"kp", "kv", "force"}  # type: ignore[call-overload]
    assert any("speed" in item for item in found.unknown)


def test_a_model_with_servos_keeps_them_and_its_fingers_push(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    found = propose_robot(str(bundled_file("panda").with_name("panda.xml")), file)
    said = loaded(found, file)
    assert "gains" not in said and len(said["finger"]) >= 2  # type: ignore[arg-type]
    ours, theirs = load_robot(file), load_robot("panda")
    at, _ = Kinematics(ours).gripper(np.array(theirs.home))
    there, _ = Kinematics(theirs).gripper(np.array(theirs.home))
    assert at == pytest.approx(there, abs=0.02)


def test_of_two_arms_the_first_is_taken_and_the_trunk_is_none_of_it(tmp_path: Path) -> None:
    two = links("waist", 1, links("a", 5) + links("b", 5))
    found = propose_robot(model(tmp_path, two), tmp_path / "arm.toml")
    assert found.joints == ("aj0", "aj1", "aj2", "aj3", "aj4")
    assert any("from bj0 to bj4" in item for item in found.guessed)


def test_fingers_that_turn_are_no_joints_of_the_arm(tmp_path: Path) -> None:
    jaw = '<body name="jaw"><joint name="gripper" axis="0 1 0"/><geom size=".01" pos="0 0 .25" mass=".1"/></body>'
    found = propose_robot(model(tmp_path, links("a", 6, jaw)), tmp_path / "arm.toml")
    assert found.joints[-1] == "aj5" and len(found.joints) == 6
    assert "jaw" in tomllib.loads(found.text)["finger"]


@pytest.mark.parametrize("count", [0, 3, 9])
def test_what_is_no_arm_is_refused_in_one_line(tmp_path: Path, count: int) -> None:
    with pytest.raises(UsageError, match="expected one arm of 4 to 8 hinges"):
        propose_robot(model(tmp_path, links("a", count) or '<geom size=".1"/>'), tmp_path / "arm.toml")


def test_a_base_that_hangs_in_the_air_is_put_on_the_table(tmp_path: Path) -> None:
    raised = f'<body name="foot" pos=".5 0 .9"><geom type="box" size=".1 .1 .05"/>{links("a", 6)}</body>'
    found = propose_robot(model(tmp_path, raised), tmp_path / "arm.toml")
    assert tomllib.loads(found.text)["base"]["pos"] == pytest.approx([-0.5, 0, -0.85])


def test_gains_are_those_of_a_critically_damped_servo() -> None:
    robot = load_robot(HERE / "torque.toml")
    torque = np.full(robot.joint_count, np.inf)
    gains = propose_gains(robot.model, robot.names.joints, torque, bandwidth=1 / np.pi)  # omega = 2
    assert np.array(gains.kp) == pytest.approx(np.array(gains.kv), rel=0.01), "kp = 4 I and kv = 4 I at two radians per second"
    stiffer = propose_gains(robot.model, robot.names.joints, np.full(robot.joint_count, 2500.0), bandwidth=1 / np.pi)
    assert min(stiffer.kp) >= 40, "a motor of 2500 N·m has at least 10 kg·m²"


def test_a_urdf_says_how_fast_its_joints_are(tmp_path: Path) -> None:
    parts, last = ['<link name="base"/>'], "base"
    for i in range(6):
        axis = "0 0 1" if i in (0, 5) else "0 1 0"
        parts.append(
            f'<link name="l{i}"><inertial><mass value="1"/><origin xyz="0 0 .1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0"'
            f' ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 .1"/><geometry><cylinder radius=".03" length=".12"/>'
            f'</geometry></collision></link><joint name="j{i}" type="revolute"><parent link="{last}"/><child link="l{i}"/>'
            f'<origin xyz="0 0 .2"/><axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="50"'
            f' velocity="{1 + i}"/></joint>'
        )
        last = f"l{i}"
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>', encoding="utf-8")
    file = tmp_path / "arm.toml"
    said = loaded(propose_robot(str(path), file), file)
    assert said["speed_limit"] == [1, 2, 3, 4, 5, 6] and said["model"] == "arm.urdf"
    assert said["gains"]["force"] == [50] * 6  # type: ignore[index]
