"""The push: a box that rests, slides, is pushed and gets lost as a real one does, and what is earned for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from worlds import SAWYER, push_env, world

from skillcli.errors import UsageError
from skillcli.recipe import load_recipe, resolve
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.rotations import upright
from skillcli.simulation.table import turned
from skillcli.tasks.push.environment import LOST, PushEnvironment
from skillcli.tasks.push.settings import TURN, PushTask
from skillcli.trajectories import Array

TASK = PushTask()
PAPER = PushTask(box_size=(0.11, 0.11, 0.13), start=(-0.3029, -1.1241, 0.0478, 1.7676, -0.0258, 0.928, 2.9807))
GRAVITY = 9.81
SUNK = 2e-3  # m, deeper does its own weight not press a box into the table

# Joint vectors with the finger straight down, rad.
LOW = (-0.3136, -0.9103, 0.0646, 1.8058, -0.0633, 0.6773, 3.0111)  # 3 cm above the table at (.6, 0)
BESIDE = (LOW[0] - 0.15, *LOW[1:])  # turned about the base: 9 cm to the right of there
ABOVE = (-0.3102, -0.9977, 0.0591, 1.8036, -0.0462, 0.7663, 2.9975)  # 7.5 cm above the table at (.6, 0)
BELOW = (-0.3131, -0.6236, 0.0646, 1.7316, -0.1169, 0.4665, 3.0523)  # 10 cm below the top of the table there


def everyone(env: PushEnvironment) -> Array:
    return np.arange(env.num_envs)


def still(env: PushEnvironment, steps: int) -> Array:
    """Leave the arms where they are; poses of the boxes, (T, N, 7)."""
    return moved(env, np.zeros((steps, 7)))


def moved(env: PushEnvironment, actions: Array) -> Array:
    """Every arm does the same; poses of the boxes, (T, N, 7)."""
    poses = []
    for action in actions:
        assert not env.step(np.tile(action, (env.num_envs, 1))).terminated.any()
        poses.append(env.arms.object_pose.copy())
    return np.stack(poses)


def sliding(speeds: list[float], task: PushTask = TASK, direction: tuple[float, float] = (0.0, 1.0)) -> PushEnvironment:
    """Boxes at rest on the table, but for these speeds, m/s."""
    env = push_env(task, len(speeds))
    env.arms.object_velocity[:, :2] = np.outer(speeds, direction)
    return env


def depth(env: PushEnvironment, slot: int = 0) -> float:
    """How deep anything is in anything else, m: MuJoCo's own contacts for the state of a simulation."""
    model = env.arms.model
    data = mujoco.MjData(model)
    data.qpos[:] = env.arms.batch.bind("qpos")[slot]
    mujoco.mj_forward(model, data)
    return float(-min(data.contact.dist, default=0.0))


def test_the_finger_starts_clear_above_the_box() -> None:
    env = push_env(TASK, 1)
    np.testing.assert_allclose(env.arms.gripper_position[0, 1:], [0, 0.14], atol=2e-3)
    assert np.linalg.norm(env.arms.gripper_position[0, :2] - TASK.box_start) < 0.06
    np.testing.assert_allclose(env.arms.object_pose[0], [0.6, 0, 0.03, 1, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("task", [TASK, PAPER], ids=["ours", "the paper's"])
def test_a_box_at_rest_stays_at_rest_while_the_arm_stays_away(task: PushTask) -> None:
    env = push_env(task, 2)
    start = env.arms.object_pose.copy()
    assert start[0, 2] == pytest.approx(task.box_size[2] / 2) and depth(env) < 1e-6
    still(env, 10)
    settled = env.arms.object_pose.copy()
    np.testing.assert_allclose(settled[:, :2], start[:, :2], atol=1e-5)
    assert (np.abs(settled[:, 2] - start[:, 2]) < SUNK).all()
    poses = still(env, 60)
    np.testing.assert_allclose(poses, np.broadcast_to(settled, poses.shape), atol=1e-5)
    assert np.abs(env.arms.object_velocity).max() < 1e-4, "and gains no kinetic energy"


# edges of the box, m, and the share of starts (at most) for which the box is set aside
SIZES = [((0.06, 0.06, 0.06), 0.03), ((0.11, 0.11, 0.13), 0.2), ((0.3, 0.05, 0.1), 0.2), ((0.05, 0.05, 0.12), 0.2)]


@pytest.mark.parametrize(("size", "share"), SIZES)
@pytest.mark.slow
def test_a_box_never_starts_inside_the_arm_and_so_stays_where_it_is(size: tuple[float, float, float], share: float) -> None:
    env, rng = push_env(PushTask(box_size=size), 128), np.random.default_rng(1)
    offset = rng.uniform(-0.12, 0.12, (128, 2))
    env.randomize({"object_offset": offset, "start_offset": rng.uniform(-0.15, 0.15, (128, 7))}, rng)
    env.reset(everyone(env), np.zeros(128, dtype=np.int64))
    aside = np.abs(env.arms.object_pose[:, :2] - TASK.box_start - offset).max(axis=1) > 1e-9
    assert 0 < aside.mean() <= share, "the others start where they were drawn"
    start = env.arms.object_pose.copy()
    np.testing.assert_allclose(still(env, 20)[..., :2], np.tile(start[:, :2], (20, 1, 1)), atol=1e-5)
    assert np.abs(env.arms.object_velocity).max() < 1e-3


def test_a_recipe_whose_arm_starts_inside_the_box_is_refused() -> None:
    with pytest.raises(UsageError, match=r"inside the box of \(0.11, 0.11, 0.2\)") as caught:
        push_env(PushTask(box_size=(0.11, 0.11, 0.2)), 1)
    assert "task.start" in str(caught.value.hint)
    push_env(PushTask(box_size=(0.11, 0.11, 0.13)), 1)  # the paper's box fits below the start as shipped


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.7071, -0.7071)])
def test_friction_stops_a_sliding_box_within_the_distance_of_coulomb_in_every_direction(direction: tuple[float, float]) -> None:
    speeds = [0.2, 0.4, 0.7]
    env = sliding(speeds, direction=direction)
    poses = still(env, 20)
    gone = (poses[-1, :, :2] - TASK.box_start) @ np.array(direction)
    # v^2 / (2 mu g): 3.4, 13.6 and 41.6 mm
    np.testing.assert_allclose(gone, np.square(speeds) / (2 * TASK.friction * GRAVITY), rtol=0.2)
    assert np.abs(env.arms.object_velocity).max() < 1e-3
    aside = (poses[-1, :, :2] - TASK.box_start) @ np.array([-direction[1], direction[0]])
    assert np.abs(aside).max() < 1e-3


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.8])
def test_the_recipes_friction_acts(friction: float) -> None:
    env = sliding([0.4], PushTask(friction=friction))
    gone = still(env, 20)[-1, 0, 1]
    assert gone == pytest.approx(0.4**2 / (2 * friction * GRAVITY), rel=0.2)


def test_friction_of_the_robot_at_hand_acts_in_its_own_simulation() -> None:
    env = push_env(TASK, 3)
    env.randomize({"contact_friction": np.array([0.5, 1.0, 1.4])}, np.random.default_rng(0))
    env.reset(everyone(env), np.zeros(3, dtype=np.int64))
    env.arms.object_velocity[:, 1] = 0.4
    gone = still(env, 20)[-1, :, 1]
    np.testing.assert_allclose(gone, 0.4**2 / (2 * TASK.friction * np.array([0.5, 1.0, 1.4]) * GRAVITY), rtol=0.2)


def test_the_box_is_pushed_by_the_finger_and_stopped_by_friction() -> None:
    env = push_env(PushTask(start=BESIDE), 1)
    turn = np.array([0.5, 0, 0, 0, 0, 0, 0])  # 1.2 cm of the finger per control step, to the left
    untouched = moved(env, np.tile(turn, (3, 1)))
    np.testing.assert_allclose(untouched[:, 0, :2], np.tile(TASK.box_start, (3, 1)), atol=1e-3, err_msg="not there yet")
    pushed = moved(env, np.tile(turn, (9, 1)))
    ahead = pushed[:, 0, 1] - env.arms.gripper_position[0, 1]
    assert pushed[-1, 0, 1] > 0.05 and ahead[-1] > 0.03, "in front of the finger"
    still(env, 10)
    rest = env.arms.object_pose[:, :3].copy()
    assert rest[0, 1] > 0.05 and abs(rest[0, 0] - 0.6) < 0.03
    assert rest[0, 2] == pytest.approx(0.03, abs=SUNK), "on the table"
    assert np.abs(still(env, 20)[..., :3] - rest).max() < 1e-3, "it stays where it was pushed to"


@pytest.mark.parametrize("task", [PushTask(start=ABOVE), PushTask(start=ABOVE, box_mass=3.0)], ids=["light", "heavy"])
def test_the_finger_does_not_sink_into_the_box_when_it_presses_with_all_its_strength(task: PushTask) -> None:
    env = push_env(task, 1)
    command = env.arms.batch.bind("ctrl")
    deepest, led = 0.0, 0.0
    for _ in range(40):
        way = (np.array([BELOW]) - command) / env.arms.action_limit
        env.step(way / max(1.0, np.abs(way).max()))  # all joints in step, so that the finger goes straight down
        deepest = max(deepest, depth(env))
        led = max(led, float(np.abs(command - env.arms.joint_position).max()))
    assert led > 0.1, "it was held up"
    assert env.arms.gripper_position[0, 2] > 0.05, "by the box"
    assert deepest < 0.003


@pytest.mark.parametrize(
    ("what", "index", "number"),
    [
        ("off the table", 0, 1.3),
        ("below the table", 2, -0.1),
        ("in the air", 2, 0.12),
        ("thrown", "velocity", 5.0),
        ("shot", "velocity", 1e4),
        ("lost", "velocity", np.nan),
        ("nowhere", 1, np.inf),
    ],
)
def test_a_lost_box_ends_the_episode_and_lies_at_the_start_again(
    what: str, index: Any, number: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file where it stands
    env, calm = push_env(TASK, 3), push_env(TASK, 3)
    if index == "velocity":
        env.arms.object_velocity[1, 0] = number
    else:
        env.arms.object_pose[1, index] = number
    action = np.random.default_rng(0).uniform(-1, 1, (3, 7))
    for _ in range(4):
        step, expected = env.step(action), calm.step(action)
        assert np.isfinite(step.observation).all() and np.isfinite(step.reward).all()
        np.testing.assert_array_equal(step.observation[[0, 2]], expected.observation[[0, 2]])
        if step.terminated.any():
            break
    assert step.terminated.tolist() == [False, True, False], what
    assert step.reward[1] == LOST < 10 * step.reward[0] < 0, "worse than going on for a while"
    np.testing.assert_array_equal(env.arms.object_pose[1], [0.6, 0, 0.03, 1, 0, 0, 0])
    assert (env.arms.object_velocity[1] == 0).all() and np.isfinite(env.save(everyone(env))).all()
    assert not env.step(action).terminated.any() and np.isfinite(env.privileged()).all()


def test_pushing_fast_is_not_throwing() -> None:
    env = sliding([0.9])
    still(env, 10)
    assert env.achieved_goal()[0, 1] > 0.05


# box, target, point behind the box; the box is 6 cm wide, so the point lies 4.5 cm from its centre, and slantwise more
BEHIND = [
    ((0.6, 0.0), (0.75, 0.0), (0.555, 0.0)),
    ((0.6, 0.0), (0.45, 0.0), (0.645, 0.0)),
    ((0.7, 0.1), (0.7, 0.0), (0.7, 0.145)),
    ((0.6, 0.0), (0.63, 0.04), (0.5658, -0.0456)),
    ((0.6, 0.0), (0.6, 0.0), (0.6, 0.0)),
]


@pytest.mark.parametrize(("box", "target", "behind"), BEHIND)
def test_the_point_behind_the_box_is_on_its_far_side_from_the_goal(
    box: tuple[float, float], target: tuple[float, float], behind: tuple[float, float]
) -> None:
    env = push_env(TASK, 1)
    env.arms.object_pose[:, :2], env.desired_goal[:, :2] = box, target
    np.testing.assert_allclose(env.behind(), [[*behind, 0.03]], atol=1e-9)


# distance of box and goal, distance of finger and the point behind the box, reward
EARNED = [
    (0.1, 0.0, -0.2),  # -2 * 0.1
    (0.1, 0.2, -0.3),  # and -0.5 * 0.2
    (0.05, 0.2, -0.2),  # at the rim nothing is earned yet
    (0.03, 0.2, -0.04),  # -2 * 0.03 - 0.5 * 0.2 + 0.3 * 2 / 5
    (0.015, 0.0, 0.18),  # -2 * 0.015 + 0.3 * 3.5 / 5
    (0.015, 0.2, 0.13),  # and half of the approach, which fades over the last 3 cm: -0.5 * 0.2 / 2
    (0.0, 0.2, 0.3),  # there: where the finger is does not matter
]


@pytest.mark.parametrize(("distance", "finger", "reward"), EARNED)
def test_what_the_distances_earn(distance: float, finger: float, reward: float) -> None:
    env = push_env(TASK, 1)
    # the box so that the finger is 4.5 cm west of it, and `finger` below; the goal east of it
    env.arms.object_pose[:, :3] = env.arms.gripper_position + np.array([0.045, 0, finger])
    env.desired_goal[:, :2] = env.arms.object_pose[:, :2] + np.array([distance, 0])
    if distance:
        assert np.linalg.norm(env.arms.gripper_position - env.behind()) == pytest.approx(finger)
    assert env.reward() == pytest.approx([reward])


def test_to_lose_the_box_is_worse_than_never_to_touch_it_wherever_the_shipped_recipes_start_it() -> None:
    env = push_env(TASK, 4)
    env.randomize({"object_offset": np.full((4, 2), 0.12) * [[1, 1], [-1, 1], [1, -1], [-1, -1]]}, np.random.default_rng(0))
    discount = load_recipe("push").training.discount
    for skill in range(4):
        env.reset(everyone(env), np.full(4, skill))
        assert (env.reward() / (1 - discount) > LOST).all()


def test_a_box_is_not_to_be_toppled_but_may_spin() -> None:
    env, quarter = push_env(TASK, 5), np.sqrt(0.5)
    # orientation, speed in the box's own frame, rad/s: at rest; tips; spins; on its side, where the own x is up: spins; tips
    env.arms.object_pose[:, 3:] = [(1, 0, 0, 0)] * 3 + [(quarter, 0, -quarter, 0)] * 2
    env.arms.object_velocity[:, 3:] = [(0, 0, 0), (3, 4, 9), (0, 0, 9), (9, 0, 0), (9, 0, 5)]
    np.testing.assert_allclose(env.reward()[0] - env.reward(), [0, 0.25, 0, 0, 0.25], atol=1e-12)


def test_a_box_is_to_be_pushed_and_not_struck() -> None:
    env = push_env(TASK, 4)
    env.arms.object_velocity[:, :2] = [[0, 0], [0.2, 0], [0.3, 0.4], [0, -0.3]]
    np.testing.assert_allclose(env.reward() - env.reward()[0], [0, -5 * 0.04, -5 * 0.25, -5 * 0.09], atol=1e-12)


# height of the box, how far the finger is above the table, what that costs
LEANING = [(0.06, 0.012, 0.0), (0.06, 0.004, 0.06), (0.06, -0.001, 0.11), (0.02, 0.006, 0.0), (0.02, 0.003, 0.02)]


@pytest.mark.parametrize(("box", "finger", "cost"), LEANING)
def test_a_finger_has_to_keep_off_its_own_table(box: float, finger: float, cost: float) -> None:
    env = push_env(TASK.model_copy(update={"box_size": (0.06, 0.06, box)}), 2)
    env.arms.reset_to(everyone(env), np.tile(LOW, (2, 1)), env.place_object(everyone(env)))
    height = float(env.arms.gripper_position[0, 2])
    env.randomize({"table_height": np.array([0.0, height - finger])}, np.random.default_rng(0))
    env.arms.reset_to(everyone(env), np.tile(LOW, (2, 1)), env.place_object(everyone(env)))
    env.arms.object_pose[:, 2] = height  # as high as the finger in both: how far it is from behind is the same
    high, low = env.reward()
    assert high - low == pytest.approx(cost)


def test_pressing_down_costs_from_two_weights_of_the_box_to_ten(monkeypatch: pytest.MonkeyPatch) -> None:
    weight = 0.3 * GRAVITY
    forces = np.array([[0, 0, 0], [0, 0, -2.0], [0, 0, -6.0], [50, 0, 0], [0, 9, -10], [0, 0, -300], [0, 0, 20]]) * weight
    env = push_env(TASK, len(forces))
    monkeypatch.setattr(ArmBatch, "contact_force", forces)
    np.testing.assert_allclose(env.reward()[0] - env.reward(), [0, 0, 0.15, 0, 0.3, 0.3, 0], atol=1e-3)


def test_the_force_on_what_the_arm_touches_is_that_of_its_contacts() -> None:
    env = push_env(TASK, 2)
    env.arms.reset_to(everyone(env), np.array([BESIDE, SAWYER.start("push")]), env.place_object(everyone(env)))
    for t in range(60):  # the first arm leans on the table, and comes to rest
        env.step(np.array([[0, 0.5 * (t < 20), 0, 0, 0, 0, 0], np.zeros(7)]))
    data = mujoco.MjData(env.arms.model)
    for field in ("qpos", "qvel", "ctrl"):
        getattr(data, field)[:] = env.arms.batch.bind(field)[0]
    mujoco.mj_forward(env.arms.model, data)
    box, table, wrench, force = env.arms.model.geom("box").id, env.arms.model.geom("table").id, np.zeros(6), np.zeros(3)
    for number, contact in enumerate(data.contact):
        if box not in contact.geom:
            mujoco.mj_contactForce(env.arms.model, data, number, wrench)
            on_second = wrench[:3] @ contact.frame.reshape(3, 3)
            force += on_second if contact.geom[1] == table else -on_second
    assert force[2] < -20.0
    np.testing.assert_allclose(env.arms.contact_force[0], force, atol=0.02 * abs(force[2]))
    np.testing.assert_array_equal(env.arms.contact_force[1], 0.0, err_msg="the box lies on the table without the arm's help")


def test_the_recipes_box_is_in_the_model() -> None:
    env = push_env(PushTask(box_size=(0.1, 0.04, 0.06), box_mass=1.2, friction=0.5, box_start=(0.7, 0.1)), 1)
    box, geom = env.arms.model.body("box"), env.arms.model.geom("box")
    assert geom.size.tolist() == pytest.approx([0.05, 0.02, 0.03]) and float(box.mass[0]) == pytest.approx(1.2)
    # of an evenly filled box, m / 12 (b^2 + c^2); in the order of MuJoCo, the largest first
    assert sorted(box.inertia) == pytest.approx(sorted([0.1 * (0.04**2 + 0.06**2), 0.1 * (0.1**2 + 0.06**2), 0.1 * 0.0116]))
    assert geom.friction[0] == pytest.approx(0.5)
    np.testing.assert_allclose(env.arms.object_pose[0], [0.7, 0.1, 0.03, 1, 0, 0, 0])


def test_goals_are_displacements_from_the_nominal_start() -> None:
    env = push_env(PushTask(box_start=(0.55, 0.1), goals=((0.15, 0), (0, -0.1)), names=()), 2)
    env.reset(everyone(env), np.array([1, 0]))
    np.testing.assert_allclose(env.goals, [[0.7, 0.1, 0], [0.55, 0, 0]])
    np.testing.assert_allclose(env.desired_goal, [[0.55, 0, 0], [0.7, 0.1, 0]])


def test_the_box_is_judged_in_the_plane_and_seen_from_the_finger() -> None:
    env = push_env(TASK, 1)
    env.arms.object_pose[0, :3] = [0.62, 0.05, 0.04]
    assert env.achieved_goal().tolist() == [[0.62, 0.05, 0]]
    gripper = env.arms.gripper_position[0].copy()
    np.testing.assert_allclose(env.observe()[0, 7:], gripper - [0.62, 0.05, 0.04], atol=1e-6)
    np.testing.assert_allclose(env.keypoints(), [[[0.62, 0.05, 0], gripper]])
    assert env.recorded_state()["object_pose"].tolist() == [[0.62, 0.05, 0.04, 1, 0, 0, 0]]


def perturbed(num_envs: int, **parameters: Any) -> PushEnvironment:
    env = push_env(TASK, num_envs, delay="latency" in parameters)
    env.randomize({name: np.array(values) for name, values in parameters.items()}, np.random.default_rng(0))
    env.reset(everyone(env), np.zeros(num_envs, dtype=np.int64))
    return env


def test_a_box_may_start_elsewhere_and_the_goal_stays() -> None:
    env = perturbed(2, object_offset=[[0.1, -0.05], [0, 0]])
    np.testing.assert_allclose(env.achieved_goal(), [[0.7, -0.05, 0], [0.6, 0, 0]])
    np.testing.assert_allclose(env.desired_goal, [[0.75, 0, 0], [0.75, 0, 0]])
    env.arms.object_pose[0, 0] = 1.3
    while not env.step(np.zeros((2, 7))).terminated[0]:
        pass
    np.testing.assert_allclose(env.achieved_goal()[0], [0.7, -0.05, 0], err_msg="a lost one comes back to its own start")


def test_a_box_stands_on_a_higher_or_lower_table_and_rests_there() -> None:
    env = perturbed(3, table_height=[0.005, 0.0, -0.005])
    expected = [0.035, 0.03, 0.025]
    np.testing.assert_allclose(env.arms.object_pose[:, 2], expected)
    poses = still(env, 20)
    np.testing.assert_allclose(poses[-1, :, 2], expected, atol=SUNK)
    np.testing.assert_allclose(poses[-1, :, 2] - poses[-1, 1, 2], [0.005, 0, -0.005], atol=1e-5)
    np.testing.assert_allclose(env.behind()[:, 2], poses[-1, :, 2])
    assert np.abs(env.arms.object_velocity).max() < 1e-3


def test_the_arm_may_start_elsewhere_and_the_box_does_not_follow() -> None:
    offset = np.zeros((2, 7))
    offset[1, 0] = 0.1
    env = perturbed(2, start_offset=offset)
    np.testing.assert_allclose(env.arms.joint_position - np.array(SAWYER.start("push")), offset, atol=1e-12)
    assert env.arms.gripper_position[1, 1] == pytest.approx(0.6 * 0.1, rel=0.1)
    np.testing.assert_allclose(env.achieved_goal(), [[0.6, 0, 0]] * 2)


def test_a_heavier_box_has_its_own_mass_in_its_own_simulation() -> None:
    env = perturbed(2, object_mass=[1.0, 10.0])
    env.arms.reset_to(everyone(env), np.tile(BESIDE, (2, 1)), env.place_object(everyone(env)))
    for _ in range(12):
        env.step(np.tile([0.5, 0, 0, 0, 0, 0, 0], (2, 1)))
    light, heavy = env.achieved_goal()[:, 1]
    assert light > heavy > 0.03


def test_the_value_function_may_know_goal_box_approach_and_robot() -> None:
    gain = np.ones((2, 7))
    gain[1, 0] = 1.7  # 1.1 in the mean
    env = perturbed(2, gain=gain, contact_friction=[1.0, 0.8], object_mass=[1.0, 1.3], latency=[0.0, 0.1])
    env.arms.object_pose[:, :2] = [0.65, 0.0]
    env.arms.object_velocity[1, :2] = [0.2, -0.1]
    goal, speed, approach, robot = np.split(env.privileged(), [2, 4, 7], axis=1)
    np.testing.assert_allclose(goal, [[0.1, 0]] * 2, atol=1e-6)
    np.testing.assert_allclose(speed, [[0.0, 0], [0.2, -0.1]], atol=1e-6)
    np.testing.assert_allclose(approach, env.arms.gripper_position - [0.605, 0, 0.03], atol=1e-6)
    np.testing.assert_allclose(robot, [[1.0, 1, 1, 0], [0.8, 1.3, 1.1, 2]], atol=1e-6)
    assert (push_env(TASK, 1).privileged()[0, 7:] == [1, 1, 1, 0]).all(), "the nominal robot"


def test_the_policy_sees_neither_speed_nor_goal_nor_robot() -> None:
    env, other = push_env(TASK, 1), perturbed(1, contact_friction=[0.5], object_mass=[2.0])
    other.desired_goal[:, 1] = 0.3
    other.arms.object_velocity[:] = 0.1
    np.testing.assert_array_equal(env.observe(), other.observe())


def test_where_the_box_is_follows_from_what_the_paper_observes_and_is_shown_where_the_task_says_so() -> None:
    seeing = push_env(PushTask(observe_place=True, observe_command=True), 2)
    seeing.randomize({"object_offset": np.array([[0.1, -0.05], [0, 0]])}, np.random.default_rng(0))
    seeing.reset(everyone(seeing), np.zeros(2, dtype=int))
    assert (push_env(TASK, 1).observation_size, seeing.observation_size) == (10, 19)
    for _ in range(3):
        seen = seeing.step(np.full((2, 7), 0.3)).observation
    np.testing.assert_allclose(seen[:, 10:12], [[0.7, -0.05], [0.6, 0.0]], atol=1e-5)
    np.testing.assert_allclose(seen[:, 10:12], seeing.arms.gripper_position[:, :2] - seen[:, 7:9], atol=1e-6)
    np.testing.assert_allclose(seen[:, 12:], seeing.arms.commanded - seen[:, :7], atol=1e-6)


def test_the_place_of_the_box_is_shown_as_late_and_as_wrong_as_the_sensors_tell_it() -> None:
    env = push_env(PushTask(observe_place=True), 1)
    env.randomize({"observation_latency": np.array([0.1])}, np.random.default_rng(0))
    env.reset(everyone(env), np.zeros(1, dtype=int))
    env.arms.object_velocity[:, 1] = 0.5
    places = [env.arms.object_pose[0, :2].copy()]
    for _ in range(3):
        seen = env.step(np.zeros((1, 7))).observation
        places.append(env.arms.object_pose[0, :2].copy())
    np.testing.assert_allclose(seen[0, 10:12], places[-3], atol=1e-6)
    assert places[-1][1] - places[-3][1] > 1e-3
    noisy = push_env(PushTask(observe_place=True), 64)
    noisy.randomize({"position_noise": np.full(64, 0.01)}, np.random.default_rng(0))
    noisy.reset(everyone(noisy), np.zeros(64, dtype=int))
    off = noisy.observe()[:, 10:12] - noisy.arms.object_pose[:, :2]
    assert off.std() == pytest.approx(0.01, rel=0.2)
    np.testing.assert_allclose(off, noisy.estimate_state().achieved_goal[:, :2] - noisy.arms.object_pose[:, :2], atol=1e-6)


def test_a_box_that_lies_still_is_seen_to_lie_still_however_late_the_sensors_are_and_the_arm_moves() -> None:
    env = perturbed(2, observation_latency=[0.1, 0.125])
    for _ in range(6):
        env.step(np.tile([1.0, 0, 0, 0, 0, 0, 0], (2, 1)))
    assert np.linalg.norm(env.arms.gripper_position[0, :2] - [0.65, 0]) > 0.05
    np.testing.assert_allclose(env.estimate_state().achieved_goal, env.achieved_goal(), atol=1e-6)


def test_a_moving_box_is_seen_where_it_was() -> None:
    env = perturbed(1, observation_latency=[0.1])
    env.arms.object_velocity[:, [1, 5]] = 0.5, 5.0
    poses = [env.arms.object_pose[0].copy()]
    for _ in range(3):
        env.step(np.zeros((1, 7)))
        poses.append(env.arms.object_pose[0].copy())
    seen = env.estimate_state()
    assert seen.achieved_goal[0, 1] == pytest.approx(poses[-3][1], abs=1e-6)
    np.testing.assert_allclose(seen.state[0, -4:], poses[-3][3:], atol=1e-6)
    assert poses[-1][1] - poses[-3][1] > 1e-3 and poses[-1][6] - poses[-3][6] > 1e-3


def test_which_way_a_box_leans_is_seen_whichever_face_is_on_top() -> None:
    env = push_env(TASK, 1)
    for degrees, leans in ((0, 0), (20, 20), (-20, -20), (90, 0), (110, 20)):
        half, along = np.radians(degrees) / 2, np.array([[0.28, 0.96]])  # where its x points
        env.arms.object_pose[:, 3:] = turned(np.array([[0.8, 0, 0, 0.6]]), np.array([[np.cos(half), 0, np.sin(half), 0]]))
        np.testing.assert_allclose(env.estimate_state().tilt, np.sin(np.radians(leans)) * along, atol=1e-6)


def test_the_room_between_finger_and_box() -> None:
    env = push_env(TASK, 1)
    env.arms.object_pose[0, :3] = env.arms.gripper_position[0] - [0.07, 0, 0.02]
    assert env.room()[0] == pytest.approx(0.04)
    env.arms.object_pose[0, :3] += [0, 0.07, 0.0]
    assert env.room()[0] == pytest.approx(np.hypot(0.04, 0.04))


@pytest.mark.parametrize(("degrees", "imagined"), [(5, 0), (30, 30), (90, 0)])
def test_a_box_that_leans_is_imagined_leaning_and_one_that_lies_is_imagined_flat(degrees: float, imagined: float) -> None:
    seen, half = push_env(TASK, 1), np.radians(degrees) / 2
    seen.arms.object_pose[:, 3:] = [np.cos(half), np.sin(half), 0, 0]
    planner = push_env(TASK, 2)
    planner.set_estimated_state(np.array([1]), seen.estimate_state().state)
    assert np.degrees(np.arccos(planner._up()[1, 2])) == pytest.approx(imagined, abs=1e-3)
    assert planner._sunk()[1] == pytest.approx(0, abs=1e-9), "its lowest corner is on the table"


def test_a_box_on_a_tilted_table_is_imagined_flat_on_the_planners_own() -> None:
    seen = perturbed(1, table_tilt=[(0.15, -0.1)])
    about_z = np.array([[np.cos(0.2), 0, 0, np.sin(0.2)]])
    seen.arms.object_pose[:, 3:] = turned(seen.arms.object_pose[:, 3:], about_z)
    planner = push_env(TASK, 2)
    planner.set_estimated_state(np.array([1]), seen.estimate_state().state)
    assert planner.arms.object_pose[1, 2] == pytest.approx(0.03) and depth(planner, 1) < 1e-9
    w, x, y, z = planner.arms.object_pose[1, 3:]
    assert (x, y) == (0, 0) and 2 * np.arctan2(z, w) == pytest.approx(0.4)
    start = planner.achieved_goal()[1]
    planner.step(np.zeros((2, 7)))
    np.testing.assert_allclose(planner.achieved_goal()[1], start, atol=1e-4, err_msg="and does not slip off by itself")


def test_the_terms_of_the_reward_add_up_to_it_and_costs_are_below_zero() -> None:
    env = push_env(TASK, 8)
    for action in np.random.default_rng(2).uniform(-1, 1, (12, 8, 7)):
        step = env.step(action)
    assert tuple(step.reward_terms) == env.reward_names
    assert env.reward_names == ("goal", "approach", "near", "struck", "tipping", "low", "pressed")
    fine = ~step.terminated
    np.testing.assert_allclose(sum(step.reward_terms.values())[fine], step.reward[fine], atol=1e-12)
    assert all((step.reward_terms[name] <= 0).all() for name in ("goal", "struck", "tipping", "low", "pressed"))


def test_a_finger_that_leans_costs_only_where_that_is_asked_for() -> None:
    leaning = (*ABOVE[:5], ABOVE[5] - 1.0, ABOVE[6])  # turned by 1 rad at the wrist
    for angle, start in ((0.0, ABOVE), (1.0, leaning)):
        env = push_env(PushTask(start=start, upright=0.5, box_start=(0.8, 0.3)), 1)
        env.reset(np.arange(1), np.zeros(1, dtype=int))
        expected = -0.5 * max(0.0, np.cos(np.radians(30)) - np.cos(angle))
        assert env.step(np.zeros((1, 7))).reward_terms["leaning"][0] == pytest.approx(expected, abs=0.02)
    assert "leaning" not in push_env(TASK, 1).reward_names


TURNING = PushTask(goals=((0.1, 0.0, 0.5), (0.1, 0.0, -0.5)))


def turning() -> PushEnvironment:
    """A box that should turn to the left, and one to the right."""
    env = push_env(TURNING, 2)
    env.reset(everyone(env), np.array([0, 1]))
    return env


def test_a_turn_is_the_third_coordinate_of_a_goal_and_ten_degrees_count_as_three_centimetres() -> None:
    env = turning()
    np.testing.assert_allclose(env.goals, [[0.7, 0.0, 0.5 * TURN], [0.7, 0.0, -0.5 * TURN]])
    assert np.radians(10) * TURN == pytest.approx(0.03)
    env.arms.object_pose[:, 3:] = upright(np.array([0.5, -0.5 + np.radians(10)]))
    env.arms.object_pose[:, 0] = 0.7
    np.testing.assert_allclose(env.desired_goal - env.achieved_goal(), [[0, 0, 0], [0, 0, -0.03]], atol=1e-12)
    headings = np.arctan2(*env.observe()[:, -2:].T)
    np.testing.assert_allclose(headings, [0.5, -0.5 + np.radians(10)], atol=1e-6)


def test_the_finger_is_led_beside_the_middle_of_a_box_that_has_to_turn() -> None:
    env = turning()
    np.testing.assert_allclose(env.behind()[:, 1], [-0.021, 0.021], atol=1e-9)
    env.arms.object_pose[:, 3:] = upright(np.array([0.5, -0.5]))
    np.testing.assert_allclose(env.behind()[:, 1], 0.0, atol=1e-9)


def test_a_noisy_camera_sees_where_a_box_points_as_well_as_where_it_is() -> None:
    env = push_env(TURNING, 400)
    env.randomize({"position_noise": np.full(400, 0.003)}, np.random.default_rng(0))
    env.reset(everyone(env), np.zeros(400, dtype=int))
    seen = env.observe()
    headings, told = np.arctan2(*seen[:, -2:].T), env.estimate_state().achieved_goal[:, 2] / TURN
    for angle in (headings, told):
        assert 0.03 < angle.std() < 0.12, "millimetres over half an edge"


@pytest.mark.parametrize(
    ("goals", "said"),
    [
        ([[0.1, 0.0, 0.4], [0.1, 0.0]], "all of them alike"),
        ([[0.1, 0.0, 2.5]], "up to 2 rad"),
        ([[0.1]], "task.goals"),
        ([[0.1, 0.0, 0.4, 0.0]], "task.goals"),
    ],
)
def test_goals_that_are_neither_places_nor_turns_are_refused(goals: list[list[float]], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        resolve({"name": "t", "task": {"name": "push", "goals": goals}})


def test_a_goal_may_turn_a_box_to_either_side_but_not_round() -> None:
    both = world(TURNING)
    both.check_goal(np.array(both.place_goal([0.1, 0.1, -1.9])))
    with pytest.raises(UsageError, match=r"2\.1 rad is too far"):
        both.check_goal(np.array(both.place_goal([0.1, 0.1, 2.1])))
    with pytest.raises(UsageError, match="3 numbers, got 2"):
        both.place_goal([0.1, 0.1])
