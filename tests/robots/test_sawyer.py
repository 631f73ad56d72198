"""The arm: its numbers against the public model, and what it may and may not do."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from worlds import SAWYER, reach_env

from skillcli.robots.scene import LIMIT_MARGIN
from skillcli.tasks.reach.environment import ReachEnvironment
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

# 200 random joint vectors (rad) with position (m) and z axis of the flange, computed from the MuJoCo Menagerie model
# rethink_robotics_sawyer.
FLANGE = Path(__file__).parent / "sawyer_flange.csv"
EVERYONE = np.arange(14)
HOME = (0.0, -1.18, 0.0, 2.18, 0.0, 0.57, 3.3161)
STRETCHED = (0.3, -0.2, 0.1, 0.3, 0.0, 0.2, 0.0)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return SAWYER.model


def test_the_flange_is_where_the_public_model_has_it(model: mujoco.MjModel) -> None:
    table = np.loadtxt(FLANGE, delimiter=",", skiprows=1)
    assert table.shape == (200, 13)
    data = mujoco.MjData(model)
    found = np.empty((200, 6))
    for row, joints in zip(found, table[:, :7], strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        flange = data.site("flange")
        row[:] = [*flange.xpos, *flange.xmat.reshape(3, 3)[:, 2]]
    np.testing.assert_allclose(found, table[:, 7:], atol=1e-5, rtol=0)


def test_masses_add_up(model: mujoco.MjModel) -> None:
    finger = float(model.body("finger").mass[0])
    assert finger == pytest.approx(0.26)
    assert float(model.body("base").subtreemass[0]) - finger == pytest.approx(20.7345, abs=1e-4)


def test_joints_have_the_published_ranges_and_efforts(model: mujoco.MjModel) -> None:
    ranges = [model.joint(name).range.tolist() for name in SAWYER.names.joints]
    assert ranges == [
        [-3.0503, 3.0503], [-3.8095, 2.2736], [-3.0426, 3.0426], [-3.0439, 3.0439], [-2.9761, 2.9761], [-2.9761, 2.9761],
        [-4.7124, 4.7124],
    ]  # fmt: skip
    assert model.actuator_forcerange[:, 1].tolist() == [80, 80, 40, 40, 9, 9, 9]
    assert model.body_gravcomp[1:-1].tolist() == [1.0] * (model.nbody - 2), "all links, not the table"


def test_the_finger_is_fifteen_centimetres_long_and_points_down_at_the_start(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qpos[:] = SAWYER.start("reach")
    mujoco.mj_kinematics(model, data)
    gripper, flange = data.site("gripper"), data.site("flange")
    np.testing.assert_allclose(gripper.xpos, [0.6, 0, 0.25], atol=2e-3)
    np.testing.assert_allclose(flange.xpos - gripper.xpos, [0, 0, 0.15], atol=2e-3)


@pytest.mark.parametrize("pose", [HOME, STRETCHED, SAWYER.start("reach")])
def test_gravity_compensation_keeps_the_arm_where_it_is(pose: tuple[float, ...]) -> None:
    env = reach_env(ReachTask(start=pose), 1)
    before = env.achieved_goal()
    for _ in range(40):  # 2 s
        env.step(np.zeros((1, 7)))
        assert np.linalg.norm(env.achieved_goal() - before) < 1e-3


@pytest.fixture(scope="module")
def pushed() -> tuple[ReachEnvironment, Array, Array]:
    """14 arms, each driven from near a limit against it: every joint, both directions. Angles and speeds, (T, 14, 7)."""
    env = reach_env(ReachTask(), 14)
    joint, sign = EVERYONE // 2, np.where(EVERYONE % 2, 1.0, -1.0)
    low, high = (env.arms.model.jnt_range[:7, side] for side in (0, 1))
    pose = np.tile(STRETCHED, (14, 1))
    pose[EVERYONE, joint] = np.where(sign > 0, high[joint] - 0.4, low[joint] + 0.4)
    env.arms.reset_to(EVERYONE, pose)
    speed = env.arms.batch.bind("qvel")
    action = np.zeros((14, 7))
    action[EVERYONE, joint] = sign
    angles, speeds = [], []
    for _ in range(40):
        env.step(action)
        angles.append(env.arms.joint_position)
        speeds.append(speed.copy())
    return env, np.stack(angles), np.stack(speeds)


def test_no_joint_leaves_its_range(pushed: tuple[ReachEnvironment, Array, Array]) -> None:
    env, angles, _ = pushed
    limits = env.arms.model.jnt_range[:7]
    assert (angles >= limits[:, 0]).all() and (angles <= limits[:, 1]).all()
    joint = EVERYONE // 2
    end = angles[-1, EVERYONE, joint]
    nearest = np.where(EVERYONE % 2, limits[joint, 1], limits[joint, 0])
    free = np.delete(EVERYONE, [6, 7])  # joint 3 folds the arm onto itself first
    np.testing.assert_allclose(np.abs(end - nearest)[free], LIMIT_MARGIN, atol=2e-3)


def test_joints_keep_their_speed_limits_at_full_action(pushed: tuple[ReachEnvironment, Array, Array]) -> None:
    free = np.delete(EVERYONE, [6, 7])  # joint 3 folds the arm onto itself before it gets to its limits
    assert (np.abs(pushed[2][:, free]) < SAWYER.speed_limit).all()
    env = reach_env(ReachTask(), 8)
    speed = env.arms.batch.bind("qvel")
    rng = np.random.default_rng(0)
    fastest = np.zeros(7)
    for t in range(48):
        if t % 8 == 0:
            action = rng.choice([-1.0, 1.0], (8, 7))
        env.step(action)
        fastest = np.maximum(fastest, np.abs(speed).max(axis=0))
    assert (fastest < SAWYER.speed_limit).all() and (fastest > 0.5).all()


def test_the_commanded_target_does_not_run_away_from_an_arm_that_is_held_up() -> None:
    env = reach_env(ReachTask(), 1)
    arms, command = env.arms, env.arms.batch.bind("ctrl")
    measured = arms.joint_position
    for _ in range(60):  # into the table, with the shoulder
        env.step(np.array([[0, 1.0, 0, 0, 0, 0, 0]]))
        assert (np.abs(command - measured) <= arms.MAX_TRACKING_ERROR + 1e-12).all()
        measured = arms.joint_position
    assert env.achieved_goal()[0, 2] > -0.02, "the table holds"
    assert np.abs(command - measured)[0, 1] > 0.1, "it was held up"
    for _ in range(20):  # and comes off at once
        env.step(np.array([[0, -1.0, 0, 0, 0, 0, 0]]))
    assert env.achieved_goal()[0, 2] > 0.05


@pytest.mark.parametrize("velocity", [np.nan, np.inf, 1e4])
def test_an_unstable_simulation_fails_alone_and_ends_in_a_clear_state(
    velocity: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file where it stands
    env, calm = reach_env(ReachTask(), 3), reach_env(ReachTask(), 3)
    action = np.random.default_rng(0).uniform(-1, 1, (3, 7))
    env.arms.batch.bind("qvel")[1] = velocity
    step, expected = env.step(action), calm.step(action)
    assert step.terminated.tolist() == [False, True, False] and not step.truncated.any()
    assert np.isfinite(step.observation).all() and np.isfinite(step.reward).all()
    for _ in range(3):
        np.testing.assert_array_equal(step.observation[[0, 2]], expected.observation[[0, 2]])
        step, expected = env.step(action), calm.step(action)
        assert not step.terminated.any() and np.isfinite(env.save(np.arange(3))).all()
