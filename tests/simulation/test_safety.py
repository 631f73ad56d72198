"""Safety limits: what breaks them, and what does not."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from worlds import SAWYER, point_env, push_env, reach_env

from skillcli.simulation.environment import SAFETY_LIMITS
from skillcli.simulation.safety import BOX_TOLERANCE, RANGE_TOLERANCE, Clearance
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.environment import ReachEnvironment
from skillcli.tasks.reach.settings import ReachTask

RANGE, SPEED, TABLE, BOX, TIPPED = range(5)

SCENE = """
<mujoco>
  <worldbody>
    <geom name="table" type="box" size="1 1 0.1" pos="0 0 -0.1"/>
    <body name="arm" pos="{x} 0 {z}"><joint type="hinge"/><geom {shape} mass="1"/></body>
    <body name="ghost" pos="0 0 -0.05"><joint/><geom size="0.2" contype="0" conaffinity="0"/></body>
    <body name="box" pos="0 0 -0.05"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  </worldbody>
</mujoco>
"""


def depth(shape: str, z: float, x: float = 0.0) -> float:
    model = mujoco.MjModel.from_xml_string(SCENE.format(shape=shape, x=x, z=z))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(Clearance(model).depth(data.geom_xpos[None], data.geom_xmat[None])[0])


@pytest.mark.parametrize(
    ("shape", "lowest"),
    [
        ('type="sphere" size="0.1"', 0.1),
        ('type="capsule" size="0.1 0.3"', 0.4),
        ('type="capsule" size="0.1 0.3" euler="90 0 0"', 0.1),
        ('type="capsule" size="0.1 0.3" euler="0 60 0"', 0.25),
        ('type="cylinder" size="0.1 0.3"', 0.3),
        ('type="cylinder" size="0.1 0.3" euler="90 0 0"', 0.1),
        ('type="box" size="0.1 0.2 0.3"', 0.3),
        ('type="box" size="0.1 0.2 0.3" euler="0 90 0"', 0.1),
        ('type="ellipsoid" size="0.1 0.2 0.3"', 0.3),
    ],
)
def test_the_lowest_point_of_every_shape_counts_and_neither_objects_nor_ghosts(shape: str, lowest: float) -> None:
    assert depth(shape, lowest + 0.01) == 0
    assert depth(shape, lowest - 0.02) == pytest.approx(0.02, abs=2e-3)
    assert depth(shape, lowest - 0.02, x=2.0) == 0, "beside the table"


def test_a_long_link_that_crosses_the_table_with_both_ends_beside_it_is_found() -> None:
    assert depth('type="capsule" size="0.1 1.5" euler="0 90 0"', 0.05) == pytest.approx(0.05)


def env(num_envs: int = 2) -> ReachEnvironment:
    return reach_env(ReachTask(), num_envs)


def test_an_arm_at_the_start_breaks_nothing() -> None:
    for arms, limits in ((env(), SAFETY_LIMITS[:3]), (push_env(PushTask(), 2), SAFETY_LIMITS[:5])):
        found = arms.violations()
        assert found.shape == (2, len(limits)) and found.dtype == bool and not found.any()


def test_a_joint_past_its_range_by_more_than_a_soft_stop_gives_way_breaks_the_range() -> None:
    arms = env(3)
    high = arms.arms.model.joint("right_j3").range[1]
    arms.arms._qpos[:, 3] = high + np.array([-0.001, 0.5 * RANGE_TOLERANCE, 2 * RANGE_TOLERANCE])
    assert arms.violations()[:, RANGE].tolist() == [False, False, True]


@pytest.mark.parametrize("joint", range(7))
def test_a_joint_faster_than_its_data_sheet_breaks_the_speed(joint: int) -> None:
    arms = env(3)
    arms.arms._qvel[:, joint] = SAWYER.speed_limit[joint] * np.array([0.99, 1.01, -1.01])
    assert arms.violations()[:, SPEED].tolist() == [False, True, True]


def test_a_finger_that_is_pressed_into_the_table_breaks_the_clearance_and_one_above_it_does_not() -> None:
    arms = env()
    down = np.zeros((2, 7))
    down[1, 1] = 1.0
    broken = []
    for _ in range(40):
        arms.step(down)
        broken.append(arms.violations()[:, TABLE])
    assert not np.array(broken)[:, 0].any() and broken[-1][1]


def test_the_table_counts_where_it_is() -> None:
    arms = env()
    tip = arms.achieved_goal()[0, 2]
    arms.randomize({"table_height": np.array([tip - 0.005, tip + 0.01])}, np.random.default_rng(0))
    arms.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    assert arms.violations()[:, TABLE].tolist() == [False, True]


HALF = 0.03  # m, of the box's edge
ON_EDGE = (np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0)
ON_CORNER = (0.8804762, 0.2798481, 0.3647052, 0.1159169)  # 45 degrees about y, then 35.26 about x: a diagonal upright


@pytest.mark.parametrize(
    ("orientation", "rest"),
    [((1.0, 0, 0, 0), HALF), ((0.6, 0, 0, 0.8), HALF), (ON_EDGE, np.sqrt(2) * HALF), (ON_CORNER, np.sqrt(3) * HALF)],
)
def test_a_box_is_pressed_where_its_lowest_corner_is_too_deep(orientation: tuple[float, ...], rest: float) -> None:
    push = push_env(PushTask(), 4)
    deep = np.array([-0.01, 0.9 * BOX_TOLERANCE, 1.1 * BOX_TOLERANCE, 1.1 * BOX_TOLERANCE])
    poses = push.arms.object_pose.copy()
    poses[:, 2], poses[:, 3:] = rest - deep, orientation
    poses[3, 1] = 3.0  # beside the table: that is another failure
    push.arms.reset_to(np.arange(4), push.arms.joint_position, poses)
    assert push.violations()[:, BOX].tolist() == [False, False, True, False]


def test_a_box_is_pressed_into_the_table_that_is_there() -> None:
    push = push_env(PushTask(), 3)
    push.randomize({"table_tilt": np.array([[0.1, -0.05]] * 3), "table_height": np.full(3, 0.02)}, np.random.default_rng(0))
    push.reset(np.arange(3), np.zeros(3, dtype=np.int64))
    assert not push.violations().any()
    poses = push.arms.object_pose.copy()
    poses[:, 2] -= np.array([0.9, 1.1, 1.1]) * BOX_TOLERANCE
    push.arms.reset_to(np.arange(3), push.arms.joint_position, poses)
    assert push.violations()[:, BOX].tolist() == [False, True, True]


@pytest.mark.parametrize("axis", [(1, 0), (0, 1), (0.6, -0.8)])
def test_a_box_that_tips_past_its_edge_has_fallen_over_and_one_that_only_turns_has_not(axis: tuple[float, float]) -> None:
    push = push_env(PushTask(), 5)
    half = np.radians([0, 44, 46, 90, 180]) / 2
    poses = push.arms.object_pose.copy()
    poses[:, 2] = 0.2
    poses[:, 3:] = np.column_stack([np.cos(half), np.sin(half)[:, None] * axis, 0 * half])
    push.arms.reset_to(np.arange(5), push.arms.joint_position, poses)
    assert push.violations()[:, TIPPED].tolist() == [False, False, True, True, True]
    poses[:, 3:] = np.column_stack([np.cos(half), 0 * half, 0 * half, np.sin(half)])
    push.arms.reset_to(np.arange(5), push.arms.joint_position, poses)
    assert not push.violations()[:, TIPPED].any()


def test_looking_at_the_limits_changes_nothing() -> None:
    watched, other = env(), env()
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 2, 7)):
        watched.violations()
        np.testing.assert_array_equal(watched.step(action).observation, other.step(action).observation)


def test_a_point_has_no_limits() -> None:
    assert point_env(PointTask(), 3).violations().shape == (3, 0)
