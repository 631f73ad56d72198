"""The arms that come along beside the Sawyer: their numbers against public models, and whether they hold, follow and learn."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from skillcli.robots.import_mjcf import PREFIX
from skillcli.robots.posture import posed
from skillcli.robots.robot import Robot, load_robot
from skillcli.tasks.reach.environment import ReachEnvironment
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.world import World
from skillcli.trajectories import Array

HERE = Path(__file__).parent


class Arm(NamedTuple):
    """What is known of an arm from elsewhere."""

    site: str  # that the table of the public model is about, with its z axis
    force: list[float]  # N·m, largest torque of each joint
    mass: float  # kg, without our finger
    start: tuple[float, float, float]  # m, of the gripper
    sag: float = 0.0  # degrees, by which its weight pulls a joint away at the start


ARMS = {
    "panda": Arm("flange", [87, 87, 87, 87, 12, 12, 12], 17.4519, (0.45, 0.0, 0.25)),
    "so101": Arm("gripperframe", [2.94] * 5, 0.632006, (0.22, 0.0, 0.05), sag=0.9),
    "ur5e": Arm("flange", [150, 150, 150, 28, 28, 28], 20.9949, (0.45, 0.0, 0.25)),
}


@pytest.fixture(scope="module", params=ARMS)
def name(request: pytest.FixtureRequest) -> str:
    """Each of the arms, by name."""
    return str(request.param)


@pytest.fixture(scope="module")
def robot(name: str) -> Robot:
    """Each of the arms."""
    return load_robot(name)


def make_env(robot: Robot, num_envs: int) -> ReachEnvironment:
    """N simulations of reach at the start of the arm."""
    env = World(ReachTask(), robot).make_env(num_envs, 1)
    assert isinstance(env, ReachEnvironment)
    env.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))
    return env


def ranges(robot: Robot) -> Array:
    """Of the joints, (n, 2) rad."""
    found: Array = np.array([robot.model.joint(joint).range for joint in robot.names.joints])
    return found


def test_the_tool_is_where_the_public_model_has_it(robot: Robot, name: str) -> None:
    table = np.loadtxt(next(HERE.glob(f"{name}_*.csv")), delimiter=",")
    count = robot.joint_count
    assert table.shape == (200, count + 6)
    low, high = ranges(robot).T
    assert (table[:, :count] >= low).all() and (table[:, :count] <= high).all()
    found = []
    for row in table:
        site = posed(robot.model, robot.names, tuple(row[:count])).site(PREFIX + ARMS[name].site)
        found.append([*site.xpos, *site.xmat.reshape(3, 3)[:, 2]])
    np.testing.assert_allclose(found, table[:, count:], atol=1e-5, rtol=0)


def test_efforts_and_masses_are_the_published_ones(robot: Robot, name: str) -> None:
    servos = [robot.model.actuator(servo).id for servo in robot.names.servos]
    assert robot.model.actuator_forcerange[servos, 1].tolist() == ARMS[name].force
    links = [body for body in range(robot.model.nbody) if robot.model.body(body).name.startswith(PREFIX)]
    assert float(robot.model.body_mass[links].sum()) == pytest.approx(ARMS[name].mass, abs=1e-4)


def test_the_arm_is_taken_as_it_is_and_holds_itself(robot: Robot, name: str) -> None:
    if ARMS[name].sag:
        assert len(robot.notes) == 1 and "hangs 0.5 cm off where it is told to be, 'shoulder_lift' by 0.8°" in robot.notes[0]
    else:
        assert robot.notes == (), "half a degree at most, and nothing had to be changed"
    assert robot.model.opt.timestep == 0.005


def test_the_gripper_points_down_over_the_table_at_the_start(robot: Robot, name: str) -> None:
    data = posed(robot.model, robot.names, robot.home)
    np.testing.assert_allclose(data.site("gripper").xpos, ARMS[name].start, atol=2e-3)
    np.testing.assert_allclose(data.site("gripper").xmat.reshape(3, 3)[:, 2], [0, 0, -1], atol=2e-3)
    assert not len(data.contact)


def test_links_that_follow_each_other_do_not_touch(robot: Robot) -> None:
    low, high = ranges(robot).T
    link = robot.model.body_weldid
    for angles in np.random.default_rng(0).uniform(low, high, (200, robot.joint_count)):
        for contact in posed(robot.model, robot.names, tuple(angles)).contact:
            a, b = (link[robot.model.geom_bodyid[geom]] for geom in contact.geom)
            carriers = [link[robot.model.body_parentid[body]] for body in (a, b)]
            assert carriers[0] != b and carriers[1] != a, [robot.model.body(body).name for body in (a, b)]


@pytest.fixture(scope="module")
def driven(robot: Robot) -> tuple[Array, Array, Array]:
    """Each joint alone at full action, both ways, then at rest: angles, targets and speeds, (40, 2n, n)."""
    count = robot.joint_count
    env = make_env(robot, 2 * count)
    action = np.zeros((2 * count, count))
    action[np.arange(2 * count), np.arange(2 * count) // 2] = np.tile([1.0, -1.0], count)
    angles, targets, speeds = [], [], []
    for t in range(40):
        env.step(action * (t < 5))
        angles.append(env.arms.joint_position)
        targets.append(env.arms.commanded.copy())
        speeds.append(env.arms.joint_velocity)
    return np.stack(angles), np.stack(targets), np.stack(speeds)


def test_every_joint_follows_its_target_and_comes_to_rest_there(
    robot: Robot, name: str, driven: tuple[Array, Array, Array]
) -> None:
    angles, targets, speeds = driven
    which = np.arange(2 * robot.joint_count)
    joint, way = which // 2, np.tile([1.0, -1.0], robot.joint_count)
    told = targets[4, which, joint] - np.array(robot.home)[joint]
    np.testing.assert_allclose(told, 5 * 0.04 * way, atol=1e-9)
    assert np.abs(targets - angles).max() < 0.1, "no joint lags by more, and none moves another"
    assert (speeds[1:5, which, joint] * way > 0.2).all(), "it moves on steadily, it does not shake"
    assert np.abs(speeds[-1]).max() < 0.01
    assert np.degrees(np.abs(targets[-1] - angles[-1])).max() < 0.5 + ARMS[name].sag


def test_joints_keep_the_speed_of_the_data_sheet(robot: Robot, driven: tuple[Array, Array, Array]) -> None:
    assert (np.abs(driven[2]) < robot.speed_limit).all()
    assert np.abs(driven[2]).max() > 0.4


def test_the_arm_stays_whole_under_random_actions(robot: Robot) -> None:
    env = make_env(robot, 4)
    low, high = ranges(robot).T
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 4, robot.joint_count)):
        step = env.step(action)
        assert np.isfinite(step.observation).all() and np.isfinite(step.reward).all() and not step.terminated.any()
        assert (env.arms.joint_position >= low).all() and (env.arms.joint_position <= high).all()
        assert (np.abs(env.arms.joint_velocity) < robot.speed_limit).all()


def test_only_primitives_stand_in_the_model(robot: Robot) -> None:
    kinds = {mujoco.mjtGeom(kind) for kind in robot.model.geom_type}
    shapes = mujoco.mjtGeom
    assert kinds <= {shapes.mjGEOM_CAPSULE, shapes.mjGEOM_CYLINDER, shapes.mjGEOM_BOX, shapes.mjGEOM_SPHERE}


def test_the_fingers_of_the_panda_stay_closed() -> None:
    robot = load_robot("panda")
    env = make_env(robot, 4)
    slides = [robot.model.joint(f"{PREFIX}finger_joint{which}").qposadr[0] for which in (1, 2)]
    for action in np.random.default_rng(0).uniform(-1, 1, (40, 4, 7)):
        env.step(action)
        assert np.abs(env.arms.batch.bind("qpos")[:, slides]).max() < 1e-3
