"""The blocks task: where skills begin, what is judged and seen, and when a block is lost."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import PANDA, SAWYER, blocks_env

from skillcli.errors import UsageError
from skillcli.hull import Hull
from skillcli.recipe import resolve
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.environment import NO_SKILL, SAFETY_LIMITS
from skillcli.simulation.rotations import frames
from skillcli.tasks.blocks.environment import HAND_ABOVE, HAND_HIGH, LET_GO, LOST, BlocksEnvironment
from skillcli.tasks.blocks.geometry import QUARTERS, heading
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.world import World
from skillcli.trajectories import Array

START = (0.0, 0.0294, 0.0, -2.3707, 0.0, 2.4004, 0.785)  # of the Panda, 20 cm above the block
TASK = BlocksTask(start=START)
ABOVE, LIFT, CARRY, PLACE = 0, 1, 2, 10  # skills of the default task
SKILLS = np.array([ABOVE, LIFT, CARRY, PLACE])
DOWN = 0.02  # m, the middle of a block on the table
STILL, CLOSE, OPEN = (np.array([0.0] * 7 + [closing]) for closing in (0.0, -1.0, 1.0))


def begun(skills: Array, progress: float = 0.0, seed: int = 1, task: BlocksTask = TASK) -> BlocksEnvironment:
    """Begin these skills with blocks at random places and angles."""
    count, rng = len(skills), np.random.default_rng(seed)
    env = blocks_env(task, count, 1)
    drawn = {"object_offset": rng.uniform(-0.1, 0.1, (count, 2)), "object_yaw": rng.uniform(-3, 3, count)}
    env.randomize({**drawn, "start_progress": np.full(count, progress)}, rng)
    env.reset(np.arange(count), skills)
    return env


def drive(env: BlocksEnvironment, action: Array, steps: int) -> None:
    """Send everyone the same."""
    for _ in range(steps):
        env.step(np.tile(action, (env.num_envs, 1)))


def over_the_block(env: BlocksEnvironment) -> Array:
    """How far grippers are beside the middles of blocks, (N,) m."""
    beside: Array = np.linalg.norm(env.position()[:, :2], axis=1)
    return beside


def test_skills_begin_where_others_end() -> None:
    env = begun(SKILLS)
    assert env.held().tolist() == [False, False, True, True]
    np.testing.assert_allclose(env.arms.gripper_position[1:, 2], [HAND_ABOVE, HAND_HIGH, DOWN], atol=5e-3)
    assert (over_the_block(env)[1:] < 5e-3).all()
    np.testing.assert_allclose(env.arms.fingers.width, [0.08, 0.08, 0.04, 0.04], atol=1e-6)
    drive(env, STILL, 20)
    assert env.held().tolist() == [False, False, True, True], "and stay there"


def test_a_hand_begins_along_the_faces_of_the_block() -> None:
    env = begun(np.full(6, LIFT))
    np.testing.assert_allclose(env.observe()[:, 13:15], [[0.0, 1.0]] * 6, atol=0.05)
    assert np.ptp(heading(env.arms.fingers.axis)) > 0.3, "blocks lie at any angle"


@pytest.mark.parametrize(("progress", "height", "held"), [(0.0, HAND_ABOVE, False), (0.5, 0.02, False), (1.0, 0.02, True)])
def test_lifts_begin_further_on_as_well(progress: float, height: float, held: bool) -> None:
    env = begun(np.full(4, LIFT), progress)
    np.testing.assert_allclose(env.arms.gripper_position[:, 2], height, atol=5e-3)
    assert (env.held() == held).all()
    drive(env, STILL, 10)
    assert not env.unstable.any() and (np.abs(env.arms.object_velocity) < 1e-2).all(), "and nothing flies away"


def test_a_whole_task_begins_at_its_start_whatever_the_skills() -> None:
    env = begun(np.full(2, NO_SKILL))
    np.testing.assert_array_equal(env.arms.joint_position, [START, START])
    assert not env.held().any()


@pytest.mark.parametrize("skill", [LIFT, CARRY])
def test_a_skill_does_not_begin_from_a_state_of_which_nothing_can_become(skill: int) -> None:
    env = begun(SKILLS)
    held, free = env.save(np.array([2, 0]))
    fit, unfit = (held, free) if skill == CARRY else (free, held)
    env.reset_to_state(np.array([0, 1]), np.stack([fit, unfit]), np.full(2, skill))
    np.testing.assert_array_equal(env.save(np.array([0]))[0], fit)
    assert env.held()[1] == (skill == CARRY)


def test_a_block_is_put_down_only_from_where_it_is_down() -> None:
    env = begun(np.array([CARRY, PLACE]))
    raised, down = env.save(np.array([0, 1]))
    env.reset_to_state(np.array([0, 1]), np.stack([raised, down]), np.full(2, PLACE))
    np.testing.assert_array_equal(env.save(np.array([1]))[0], down)
    np.testing.assert_allclose(env.arms.object_pose[:, 2], DOWN, atol=2e-3)
    assert env.held().all()


def test_some_blocks_are_let_go_on_another_one_where_there_is_one() -> None:
    env = begun(np.full(4, PLACE), progress=1.0, task=TASK.model_copy(update={"others": ((0.5, 0.25),)}))
    base, block = env.arms.object_poses[:, 7:10], env.arms.object_pose[:, :3]
    np.testing.assert_allclose(block - base, [[0.0, 0.0, 0.045]] * 4, atol=1e-3)
    np.testing.assert_allclose(env.desired_goal - base, [[0.0, 0.0, 0.04]] * 4, atol=2e-3)
    assert env.held().all() and np.ptp(base[:, 0]) > 0.05
    drive(env, OPEN, 12)
    assert not env.held().any() and not env.failed().any()
    np.testing.assert_allclose(env.achieved_goal(), env.desired_goal, atol=4e-3)


def test_of_lift_only_the_height_counts() -> None:
    env = begun(np.full(1, LIFT), progress=1.0)
    env.arms.object_pose[0, :3] += [0.2, 0.1, 0.05]
    np.testing.assert_allclose(env.desired_goal - env.achieved_goal(), [[0.0, 0.0, 0.13 - 0.05]], atol=2e-3)


def test_carries_are_the_corners_of_a_cuboid_and_nothing_else_is_mixed() -> None:
    corners = np.array(TASK.goals)[list(TASK.mixing)]
    assert {TASK.kinds[skill] for skill in TASK.mixing} == {"carry"} and Hull(corners).cuboid is not None


def test_goals_of_lift_and_place_are_over_and_under_the_block_wherever_it_is() -> None:
    env = begun(SKILLS)
    block = env.arms.object_pose
    np.testing.assert_allclose(env.desired_goal[[0, 1, 3], :2], block[[0, 1, 3], :2], atol=1e-9)
    np.testing.assert_allclose(env.desired_goal[:, 2], [0.09, 0.15, 0.15, 0.02])
    np.testing.assert_allclose(env.desired_goal[2], TASK.goals[CARRY])


def test_a_block_is_placed_when_it_is_let_go() -> None:
    env = begun(np.array([PLACE, NO_SKILL, CARRY]), progress=1.0)
    raised = env.achieved_goal()[:, 2] - env.arms.object_pose[:, 2]
    np.testing.assert_allclose(raised, [LET_GO, 0.0, 0.0], atol=1e-6)
    drive(env, OPEN, 12)
    assert not env.held()[0]
    np.testing.assert_allclose(env.achieved_goal()[0], env.arms.object_pose[0, :3], atol=1e-6)
    assert np.linalg.norm(env.achieved_goal() - env.desired_goal, axis=1)[0] < TASK.tolerance


def test_fingers_close_at_the_speed_of_the_hand_and_press_with_the_force_of_the_task() -> None:
    env = begun(np.full(1, LIFT), progress=0.5)
    drive(env, CLOSE, 4)
    assert env.arms.fingers.width[0] == pytest.approx(0.08 - 4 * 0.005, abs=4e-3)
    drive(env, CLOSE, 20)
    assert env.held().all()
    force = env.arms.batch.bind("actuator_force")[0, -2:]
    np.testing.assert_allclose(-force, TASK.grip_force, rtol=0.1)


def test_holding_earns_more_than_closing_and_that_more_than_coming_near() -> None:
    earned = [begun(np.full(1, LIFT), progress).reward()[0] for progress in (0.0, 0.5, 1.0)]
    assert earned[0] < earned[1] < earned[2]


def test_losing_a_block_is_below_the_return_of_doing_nothing() -> None:
    env = begun(SKILLS, task=TASK)
    assert env.reward().min() / (1 - 0.97) > LOST


def test_terms_are_named_and_add_up() -> None:
    env = begun(SKILLS)
    step = env.step(np.zeros((4, 8)))
    assert {"goal", "near", "reach", "enclose", "hold", "early", "turned", "struck", "pressed"} <= set(step.reward_terms)
    np.testing.assert_allclose(sum(step.reward_terms.values()), step.reward, atol=1e-12)
    assert (step.reward_terms["reach"] != 0).tolist() == [False, True, False, False]


def test_blocks_that_fall_off_or_fly_are_lost() -> None:
    env = begun(np.full(3, ABOVE))
    env.arms.object_pose[0, :3] = [1.3, 0.0, -0.1]
    env.arms.object_velocity[1, 2] = 4.0
    step = env.step(np.zeros((3, 8)))
    assert step.terminated.tolist() == [True, True, False]
    np.testing.assert_array_equal(step.reward[:2], LOST)
    np.testing.assert_allclose(env.arms.object_pose[:, 2], 0.02, atol=2e-3)


def test_a_hand_that_presses_with_more_than_its_lasting_force_breaks_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    env = begun(np.full(2, LIFT), progress=0.5)
    assert not env.violations().any() and env.violations().shape == (2, len(SAFETY_LIMITS))
    forces = np.array([[0.0, 0.0, -69.0], [60.0, 0.0, -60.0]])
    monkeypatch.setattr(ArmBatch, "contact_force", property(lambda _: forces))
    assert env.violations()[:, SAFETY_LIMITS.index("hand_force")].tolist() == [False, True]


def test_fingers_are_recorded() -> None:
    recorded = begun(SKILLS).recorded_state()
    np.testing.assert_allclose(recorded["finger_position"], [[0.04] * 2, [0.04] * 2, [0.02] * 2, [0.02] * 2], atol=1e-6)
    assert recorded["object_pose"].shape == (4, 7)


def test_skills_see_the_block_that_is_attended_to() -> None:
    env = begun(np.full(2, NO_SKILL), task=TASK.model_copy(update={"others": ((0.4, 0.15),)}))
    env.attend(1)
    np.testing.assert_allclose(env.arms.object_pose[:, :3], [[0.4, 0.15, 0.02]] * 2, atol=2e-3)
    np.testing.assert_allclose(env.observe()[:, 10:12], [[0.4, 0.15]] * 2, atol=2e-3)
    env.attend(0)
    assert np.ptp(env.arms.object_pose[:, 0]) > 1e-3


def test_sensors_without_noise_show_what_is() -> None:
    sensed, plain = begun(SKILLS), begun(SKILLS)
    sensed.randomize({"position_noise": np.full(4, 1e-12)}, np.random.default_rng(0))
    for env in (sensed, plain):
        env.reset(np.arange(4), np.full(4, LIFT))
        drive(env, CLOSE, 3)
    plain.randomize({}, np.random.default_rng(0))
    plain.reset(np.arange(4), np.full(4, LIFT))
    drive(plain, CLOSE, 3)
    np.testing.assert_allclose(sensed.observe(), plain.observe(), atol=1e-6)


def test_sizes_are_known_without_a_simulation() -> None:
    world = World(TASK, PANDA)
    env = world.make_env(1, 1)
    assert world.sizes == (env.observation_size, env.action_size, env.privileged_size) == (23, 8, 7)
    np.testing.assert_allclose(world.action_scale, [0.04] * 7 + [0.02])
    assert QUARTERS == 4


def test_an_arm_without_a_hand_is_refused_with_one_line() -> None:
    with pytest.raises(UsageError, match="robot ur5e has no hand that can grasp"):
        resolve({"name": "t", "robot": "ur5e", "task": {"name": "blocks"}})
    with pytest.raises(UsageError, match="robot sawyer has no hand that can grasp"):
        World(TASK, SAWYER).make_env(1)


@pytest.mark.parametrize(
    "names", [("above",), ("push",) * 7, ("grab", "lift", "carry", "carry-2", "carry-3", "carry-4", "place")]
)
def test_names_say_what_skills_do(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="name"):
        BlocksTask(names=names)


def test_a_block_under_others_that_topples_is_a_failure() -> None:
    env = begun(np.full(3, ABOVE), task=TASK.model_copy(update={"others": ((0.45, 0.2), (0.6, -0.2))}))
    tilt = np.radians(40)
    env.arms.object_poses[1, 10:14] = [np.cos(tilt / 2), np.sin(tilt / 2), 0, 0]  # about x
    env.arms.object_poses[2, 17:21] = [np.cos(tilt / 2), 0, 0, np.sin(tilt / 2)]  # seen from above
    assert env.failed().tolist() == [False, True, False]


def test_a_block_that_is_carried_lies_in_the_hand_whatever_the_posture() -> None:
    env = begun(np.full(4, CARRY))
    env._start_offset = np.random.default_rng(2).uniform(-0.1, 0.1, (4, 7))
    env.reset(np.arange(4), np.full(4, CARRY))
    assert env.held().all() and (np.linalg.norm(env.position(), axis=1) < 1e-6).all()
    assert (-env.arms.gripper_direction[:, 2]).min() < 0.999, "hands lean"
    up_of_block = frames(env.arms.object_pose[:, 3:])[:, :, 2]
    np.testing.assert_allclose(up_of_block, -env.arms.gripper_direction, atol=1e-5)
    drive(env, STILL, 20)
    assert env.held().all() and (np.abs(env.arms.object_velocity) < 1e-2).all()


NOISE = {"joint_noise": 0.005, "position_noise": 0.004}


def believed(skill: int, progress: float = 0.0, task: BlocksTask = TASK) -> tuple[BlocksEnvironment, BlocksEnvironment]:
    """Eight hands and blocks, and the same as noisy sensors tell, both half a second later."""
    count, rng = 8, np.random.default_rng(5)
    true, told = begun(np.full(count, skill), progress, task=task), blocks_env(task, count, 1)
    noise = {name: np.full(count, value) for name, value in NOISE.items()}
    true.randomize({**noise, "start_progress": np.full(count, progress)}, rng)
    true.reset(np.arange(count), np.full(count, skill))
    told.set_estimated_state(np.arange(count), true.estimate_state().state)
    for env in (true, told):
        drive(env, STILL, 10)
    return true, told


def test_a_held_block_that_is_seen_beside_the_fingers_is_still_held() -> None:
    true, told = believed(CARRY)
    assert true.held().all() and told.held().all() and not told.failed().any()
    assert np.abs(told.position() - true.position()).max() < 0.02
    along = (told.position() * told.arms.fingers.axis).sum(axis=1)
    assert np.abs(along).max() < 2e-3, "the fingers are mirrored"


def test_a_block_that_is_seen_in_the_table_or_over_it_lies_on_it() -> None:
    true, told = believed(ABOVE)
    np.testing.assert_allclose(told.arms.object_pose[:, 2], DOWN, atol=2e-3)
    np.testing.assert_allclose(told.arms.object_pose[:, :2], true.arms.object_pose[:, :2], atol=0.02)


def test_a_block_that_is_seen_near_the_top_of_another_lies_on_it() -> None:
    task = TASK.model_copy(update={"others": ((0.5, 0.25),)})
    env, told = begun(np.full(2, ABOVE), task=task), blocks_env(task, 2, 1)
    on_top = np.array([0.505, 0.245, 3 * DOWN])
    for number, off in enumerate((0.008, -0.008)):
        env.arms.object_pose[number, :3] = on_top + np.array([0.0, 0.0, off])
    told.set_estimated_state(np.arange(2), env.estimate_state().state)
    np.testing.assert_allclose(told.arms.object_pose[:, :3], [on_top] * 2, atol=1e-6)
    drive(told, STILL, 10)
    np.testing.assert_allclose(told.arms.object_pose[:, :3], [on_top] * 2, atol=4e-3)


BASE, THIRD = (0.55, 0.1), (0.45, -0.1)
TOWER = TASK.model_copy(update={"others": (THIRD, BASE), "build": ((*BASE, 3 * DOWN), (*BASE, 5 * DOWN))})


def tower(count: int = 2) -> BlocksEnvironment:
    """A hand, a block to go on the last of three, and another one to go on that."""
    env = begun(np.full(count, NO_SKILL), task=TOWER)
    assert not env.arms.attended.any()
    return env


def put(env: BlocksEnvironment, place: tuple[float, ...], number: int = 0, block: int = 0) -> None:
    """Put a block of one simulation somewhere, upright and at rest."""
    poses = env.arms.object_poses
    poses[number, 7 * block : 7 * block + 7] = [*place, 1, 0, 0, 0]
    env.arms.batch.forward(np.array([number]))


def test_a_block_that_lies_in_its_place_is_seen_there_once_and_then_the_next_one_is_attended_to() -> None:
    env = tower()
    put(env, (BASE[0] + 0.005, BASE[1], 3 * DOWN))
    np.testing.assert_allclose(env.achieved_goal()[0], [BASE[0] + 0.005, BASE[1], 3 * DOWN])
    drive(env, STILL, 1)
    assert env.arms.attended.tolist() == [1, 0]
    np.testing.assert_allclose(env.achieved_goal()[0, :2], THIRD, atol=1e-3)
    np.testing.assert_allclose(env.position()[0], env.arms.gripper_position[0] - env.achieved_goal()[0], atol=1e-6)
    np.testing.assert_allclose(env.recorded_state()["object_pose"][0, :2], [BASE[0] + 0.005, BASE[1]], atol=2e-3)
    assert env.recorded_state()["other_poses"].shape == (2, 14), "what is recorded does not depend on attention"


def test_a_block_that_falls_from_its_place_is_attended_to_again() -> None:
    env = tower()
    put(env, (*BASE, 3 * DOWN))
    drive(env, STILL, 1)
    put(env, (BASE[0] + 0.1, BASE[1], DOWN))
    drive(env, STILL, 1)
    assert env.arms.attended.tolist() == [0, 0]


def test_attention_is_part_of_what_is_restored_and_estimated() -> None:
    env, other = tower(), tower(3)
    put(env, (*BASE, 3 * DOWN))
    drive(env, STILL, 1)
    other.restore(np.array([2]), env.save(np.array([0])))
    assert other.arms.attended.tolist() == [0, 0, 1]
    other.set_estimated_state(np.array([1, 2]), env.estimate_state().state)
    assert other.arms.attended.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(other.achieved_goal()[1], env.achieved_goal()[0])
    env.reset(np.array([0, 1]), np.full(2, NO_SKILL))
    assert not env.arms.attended.any()


def test_a_block_in_its_place_is_done_with_only_when_it_is_let_go() -> None:
    env = tower(1)
    put(env, (*env.arms.gripper_position[0, :2], 3 * DOWN))
    built = TOWER.model_copy(update={"build": ((*env.arms.gripper_position[0].tolist(),), (*BASE, 5 * DOWN))})
    env = begun(np.full(1, NO_SKILL), task=built)
    for width, attended in ((2 * DOWN, 0), (2 * DOWN + LET_GO - 0.015, 0), (2 * DOWN + LET_GO - 0.005, 1)):
        state = env.estimate_state().state
        state[0, -21:-14] = [*env.arms.gripper_position[0], 1, 0, 0, 0]
        state[0, -23:-21] = width
        env.set_estimated_state(np.array([0]), state)
        assert env.arms.attended.tolist() == [attended]


def test_no_more_blocks_are_placed_than_there_are() -> None:
    with pytest.raises(UsageError, match="places 2 blocks, there are 1"):
        resolve({"name": "t", "robot": "panda", "task": {"name": "blocks", "build": [[0.5, 0, 0.02], [0.5, 0.1, 0.02]]}})
