"""Robot files for models that have none."""

from __future__ import annotations

import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from skillcli.errors import UsageError
from skillcli.robots.chain import find_chain
from skillcli.robots.config import bundled_file
from skillcli.robots.hand import Hand, find_hand
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.new_file import NewRobot, propose_robot
from skillcli.robots.robot import load_robot
from skillcli.robots.start import POINTS_DOWN
from skillcli.robots.tuning import propose_gains, step_responses

pytestmark = pytest.mark.slow  # arms are built and moved

HERE = Path(__file__).parent
PENDULUMS = """<mujoco><compiler angle="radian"/><worldbody><body name="base">{arms}</body></worldbody></mujoco>"""
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


SERVOS = "<actuator>{}</actuator>"


def servos(count: int, kp: float, kv: float) -> str:
    return SERVOS.format("".join(f'<position joint="aj{i}" kp="{kp}" kv="{kv}"/>' for i in range(count)))


def proposed(tmp_path: Path, arms: str, more: str = "") -> tuple[NewRobot, dict[str, object]]:
    """What is proposed for arms, and what its file says."""
    path = tmp_path / "model.xml"
    path.write_text(PENDULUMS.format(arms=arms).replace("</mujoco>", f"{more}</mujoco>"), encoding="utf-8")
    found = propose_robot(str(path), tmp_path / "arm.toml")
    return found, tomllib.loads(found.text)


def chain_of(arms: str) -> tuple[str, ...]:
    """The joints that are found in arms."""
    return find_chain(mujoco.MjSpec.from_string(PENDULUMS.format(arms=arms))).joints


def hand_of(arms: str) -> Hand:
    """The hand that is found on arms."""
    spec = mujoco.MjSpec.from_string(PENDULUMS.format(arms=arms))
    return find_hand(spec, spec.compile(), find_chain(spec).joints)


def test_a_wrist_that_turns_a_body_called_gripper_is_of_the_arm() -> None:
    jaw = """<body name="jaw{0}" pos="0 {0} .2"><joint name="finger{0}" type="slide" axis="0 1 0"/>
    <geom size=".01" mass=".1"/></body>"""
    wrist = '<body name="gripper_link" pos="0 0 .2"><joint name="wrist_rotate" axis="0 0 1"/><geom size=".03"/>{}</body>'
    assert chain_of(links("a", 5, wrist.format(jaw.format(0.02))))[-1] == "wrist_rotate"
    named_so = wrist.replace("wrist_rotate", "joint_gripper").format(jaw.format(0.02) + jaw.format(-0.02))
    assert chain_of(links("a", 5, named_so))[-1] == "joint_gripper", "what carries two fingers is no finger"


def test_the_turn_of_a_mobile_base_is_no_joint_of_the_arm() -> None:
    cart = """<body name="cart"><joint name="x" type="slide"/><joint name="th" axis="0 0 1"/><geom size=".1"/>{}</body>"""
    assert chain_of(cart.format(links("a", 6))) == tuple(f"aj{i}" for i in range(6))


def test_the_hand_is_sought_away_from_the_joint_before() -> None:
    last = """<body name="wrist" pos="0 0 .2"><joint name="last" axis="0 0 1"/><inertial pos="0 0 -.01" mass=".2"
    diaginertia=".001 .001 .001"/><body name="tool" pos="0 0 -.02"/></body>"""
    assert hand_of(links("a", 5, last)).quat == (1, 0, 0, 0)


def test_a_hand_behind_a_last_joint_that_bends_points_across_its_axis() -> None:
    bends = """<body name="hand" pos="0 0 .2"><joint name="last" axis="0 1 0"/>
    <geom type="box" size=".02 .02 .06" pos="0 0 .07"/></body>"""
    hand = hand_of(links("a", 5, bends))
    assert hand.pos == pytest.approx([0, 0, 0.13]) and "across" in hand.because


def test_a_tilted_mesh_ends_where_its_vertices_do(tmp_path: Path) -> None:
    (tmp_path / "foot.obj").write_text(
        "v 0 0 0\nv .3 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="utf-8"
    )
    foot = '<body name="foot"><geom type="mesh" mesh="foot"/>' + links("a", 6) + "</body>"
    _, said = proposed(tmp_path, foot, '<asset><mesh name="foot" file="foot.obj"/></asset>')
    assert "base" not in said, "it stands on z = 0, other than the box around it"


def test_what_is_seen_of_a_base_stands_on_the_table_not_what_collides(tmp_path: Path) -> None:
    foot = """<body name="foot"><geom size=".15"/><geom type="box" size=".1 .1 .05" pos="0 0 .05" contype="0" conaffinity="0"/>
    {}</body>"""
    _, said = proposed(tmp_path, foot.format(links("a", 6)))
    assert "base" not in said


def test_the_table_of_an_arm_on_a_trunk_is_at_its_height(tmp_path: Path) -> None:
    trunk = f"""<body name="trunk"><geom type="box" size=".1 .1 .6" pos="0 0 .6"/>
    <body name="up" pos="0 0 1.2">{links("a", 6)}</body></body>"""
    _, said = proposed(tmp_path, trunk)
    assert said["base"]["pos"][2] == pytest.approx(0.4 * 1.0 - 1.4)  # type: ignore[index]
    assert "start" in said


def test_an_arm_that_looks_to_the_side_is_turned(tmp_path: Path) -> None:
    arm = links("a", 6).replace('range="-2.5 2.5"', 'range="1 2.2"', 1).replace('range="-2.5 2.5"', 'range="0 2.5"', 1)
    found, said = proposed(tmp_path, arm)
    assert said["base"]["quat"] == pytest.approx([0.70711, 0, 0, -0.70711])  # type: ignore[index]
    assert "start" in said and "turned to look along x" in found.text


def test_servos_that_do_not_hold_the_arm_are_replaced(tmp_path: Path) -> None:
    found, said = proposed(tmp_path, links("a", 6), servos(6, kp=1, kv=0.1))
    assert "gains" in said and any("own servos" in item for item in found.guessed)
    assert not any("will not train" in item for item in found.unknown)


def test_what_blocks_an_arm_is_said(tmp_path: Path) -> None:
    tendons = "".join(f'<fixed name="t{i}"><joint joint="aj{i}" coef="1"/></fixed>' for i in range(4))
    pulls = "".join(f'<position tendon="t{i}" kp="5000"/>' for i in range(4))
    found, _ = proposed(tmp_path, links("a", 4), f"<tendon>{tendons}</tendon><actuator>{pulls}</actuator>")
    assert any("will not train" in item for item in found.unknown)


def test_joints_that_are_damped_get_gains_that_move_them(tmp_path: Path) -> None:
    damped = links("a", 6).replace("<joint ", '<joint damping="60" ')
    found, _ = proposed(tmp_path, damped)
    loaded(found, tmp_path / "arm.toml")


def test_millimetres_are_asked_about(tmp_path: Path) -> None:
    small = links("a", 4).replace(".2", ".002").replace(".03", ".0003")
    found, _ = proposed(tmp_path, small)
    assert any("unit of length" in item for item in found.unknown)


def test_ranges_in_another_unit_are_asked_about(tmp_path: Path) -> None:
    found, _ = proposed(tmp_path, links("a", 6).replace("-2.5 2.5", "-.04 .04"))
    assert any("unit of the joints' ranges" in item for item in found.unknown)


URDF_LINK = """<link name="l{i}"><inertial><mass value="1"/><origin xyz="0 0 .1"/>
<inertia ixx="{ixx}" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><mesh filename="package://acme/meshes/{file}"/></geometry></collision></link>
<joint name="j{i}" type="revolute"><parent link="{last}"/><child link="l{i}"/><origin xyz="0 0 .2"/><axis xyz="{axis}"/>
<limit lower="-2.5" upper="2.5" effort="50" velocity="2"/></joint>"""


def urdf(folder: Path, file: str, ixx: float) -> Path:
    """A URDF in a package of ROS, its meshes named as ROS names them."""
    axes = ["0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 1 0", "0 0 1"]
    text = "".join(
        URDF_LINK.format(i=i, last="base" if i == 0 else f"l{i - 1}", axis=axis, file=file, ixx=ixx)
        for i, axis in enumerate(axes)
    )
    (folder / "acme" / "urdf").mkdir(parents=True)
    (folder / "acme" / "meshes").mkdir()
    path = folder / "acme" / "urdf" / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{text}</robot>', encoding="utf-8")
    return path


def test_meshes_of_a_package_are_found_and_impossible_inertia_is_mended(tmp_path: Path) -> None:
    path = urdf(tmp_path, "link.obj", ixx=0.03)
    link = "v -.02 -.02 .02\nv .03 0 .02\nv 0 .03 .02\nv 0 0 .16\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "acme" / "meshes" / "link.obj").write_text(link, encoding="utf-8")
    found = propose_robot(str(path), tmp_path / "arm.toml")
    loaded(found, tmp_path / "arm.toml")
    assert not any("missing" in item for item in found.guessed)
    assert any("no body can have the inertia" in item for item in found.guessed)


def test_meshes_that_mujoco_does_not_read_are_named_so(tmp_path: Path) -> None:
    path = urdf(tmp_path, "link.dae", ixx=0.01)
    (tmp_path / "acme" / "meshes" / "link.dae").write_text("<COLLADA/>", encoding="utf-8")
    with pytest.raises(UsageError, match="nothing is left of the arm") as caught:
        propose_robot(str(path), tmp_path / "arm.toml")
    assert "DAE, which MuJoCo does not read" in caught.value.hint


def test_a_xacro_has_to_be_expanded(tmp_path: Path) -> None:
    path = tmp_path / "arm.xacro"
    path.write_text('<robot name="arm"/>', encoding="utf-8")
    with pytest.raises(UsageError, match="cannot be read") as caught:
        propose_robot(str(path), tmp_path / "arm.toml")
    assert "xacro FILE" in caught.value.hint
