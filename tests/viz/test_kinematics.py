"""Poses and shapes against MuJoCo itself."""

from importlib import resources

import mujoco
import numpy as np
import pytest
import scenes
from worlds import PANDA, model_of

from skillcli.errors import SkillError
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.viz import kinematics

POSTURES = np.array([[0.3, -0.5, 1.1], [-1.2, 0.4, 0.7]])


def test_poses_are_those_of_mujoco_with_the_scalar_of_the_quaternion_last() -> None:
    model = scenes.arm_model(with_box=True)
    pose = np.array([[0.6, 0.1, 0.02, 0.8, 0.0, 0.0, 0.6], [0.5, 0.0, 0.03, 0.6, 0.8, 0.0, 0.0]])
    positions, quaternions = kinematics.body_poses(model, scenes.ARM_JOINTS, POSTURES, pose)
    for row in range(2):
        data = mujoco.MjData(model)
        for i in range(3):
            data.joint(f"right_j{i}").qpos[0] = POSTURES[row, i]
        data.joint("box").qpos[:] = pose[row]
        mujoco.mj_forward(model, data)
        assert np.allclose(positions[row], data.xpos)
        assert np.allclose(quaternions[row], data.xquat[:, [1, 2, 3, 0]])


def test_a_missing_joint_is_named_with_what_there_is() -> None:
    with pytest.raises(SkillError, match="no joint 'right_j3'") as caught:
        kinematics.body_poses(scenes.arm_model(), (*scenes.ARM_JOINTS, "right_j3"), np.zeros((1, 4)))
    assert "'right_j2'" in caught.value.hint


def test_z_axis_of_a_rotated_shape() -> None:
    rotation = np.array([[0.0, np.sin(np.pi / 4), 0.0, np.cos(np.pi / 4)]])  # a quarter turn about y
    assert kinematics.z_axis(rotation) == pytest.approx(np.array([[1.0, 0.0, 0.0]]), abs=1e-12)


def test_every_body_with_geoms_is_drawn_also_by_collision_geoms_alone() -> None:
    model = scenes.arm_model()
    found = kinematics.shapes(model)
    names = {kinematics.body_name(model, body): [shape.form for shape in shapes] for body, shapes in found.items()}
    assert names == {"table": ["box"], "base": ["cylinder"], "upper": ["capsule", "ellipsoid"], "lower": ["capsule"]}


def test_collision_geoms_are_left_out_where_a_body_is_dressed() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="b">
        <geom type="box" size=".1 .1 .1"/><geom type="sphere" size=".2" group="3"/>
        <geom type="sphere" size=".2" rgba="1 1 1 0"/>
        </body></worldbody></mujoco>"""
    )
    assert [shape.form for shape in kinematics.shapes(model)[1]] == ["box"]


def test_a_material_wins_over_the_colour_of_the_geom() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><material name="m" rgba=".1 .2 .3 1"/></asset>
        <worldbody><geom type="sphere" size=".2" material="m"/></worldbody></mujoco>"""
    )
    assert kinematics.shapes(model)[0][0].rgba == pytest.approx([0.1, 0.2, 0.3, 1.0])


def test_the_robot_itself_is_drawn_whole() -> None:
    source = resources.files("skillcli.robots") / "sawyer" / "sawyer.xml"
    if not source.is_file():
        pytest.skip("the robot's model is not here")
    model = mujoco.MjModel.from_xml_path(str(source))
    drawn = {kinematics.body_name(model, body) for body in kinematics.shapes(model)}
    assert {f"right_l{i}" for i in range(7)} <= drawn
    kinematics.body_poses(model, scenes.joints_of(model), np.zeros((1, 7)))


def test_collision_geoms_in_a_low_group_are_left_out_beside_visual_meshes() -> None:
    model = mujoco.MjModel.from_xml_string(scenes.TETRAHEDRON)
    assert kinematics.drawn_geoms(model) == {1: [0]}
    model.geom_contype[0] = 1  # no group is for looks alone any more
    assert kinematics.drawn_geoms(model) == {1: [0, 1]}


def test_a_mark_on_a_body_does_not_replace_it() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body>
        <geom type="box" size=".1 .1 .1"/><geom type="sphere" size=".01" group="1" contype="0" conaffinity="0"/>
        </body></worldbody></mujoco>"""
    )
    assert kinematics.drawn_geoms(model) == {1: [0, 1]}


def test_fingers_of_a_hand_are_as_far_open_as_they_were() -> None:
    model = model_of(BlocksTask())
    assert model is not None
    joints, hand = PANDA.names.joints, PANDA.graspers().joints
    ends = []
    for opened in (None, np.array([[0.01, 0.03]])):
        positions, _ = kinematics.body_poses(model, joints, np.zeros((1, 7)), None, hand, opened)
        ends.append(positions[0, [model.body(f"robot/{side}_finger").id for side in ("left", "right")]])
    np.testing.assert_allclose(np.linalg.norm(ends[1] - ends[0], axis=1), [0.01, 0.03], atol=1e-9)
