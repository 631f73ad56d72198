"""What every environment promises, asked of each of them."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import make_env, model_of, width, world

from skillcli.errors import UsageError
from skillcli.simulation.environment import Environment, Step
from skillcli.simulation.settings import ArmTask
from skillcli.simulation.settings import TaskSettings as Task
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.registry import ROOMS as DESCRIPTIONS
from skillcli.tasks.world import place_goal as goal_place
from skillcli.trajectories import Array

AROUND = (0.0, 0.464, 0.0, -2.3605, 0.0, 2.8186, 0.785)  # of the Panda, fingers around the block
CORNERS = tuple((x, y, 0.15) for x in (0.4, 0.6) for y in (-0.15, 0.15))
TASKS: dict[str, Task] = {
    "point": PointTask(horizon=12),
    "reach": ReachTask(horizon=12),
    # a tall box right beside the finger, so that random actions push it
    "push": PushTask(horizon=12, box_start=(0.6, 0.05), box_size=(0.06, 0.06, 0.2), observe_place=True),
    "push, with turns": PushTask(
        horizon=12,
        box_start=(0.6, 0.05),
        box_size=(0.06, 0.06, 0.2),
        goals=((0.1, 0.0, 0.4), (0.0, 0.1, -0.3), (-0.1, 0.0, 0.2), (0.0, -0.1, 0.0)),
    ),
    # open fingers around a block, so that random actions move it; every skill begins alike
    "blocks": BlocksTask(
        horizon=12, start=AROUND, grasped_starts=False, goals=CORNERS, names=("carry-1", "carry-2", "carry-3", "carry-4")
    ),
}
STEPS = 6


@pytest.fixture(params=TASKS)
def task(request: pytest.FixtureRequest) -> Task:
    return TASKS[request.param]


def test_every_task_is_tested() -> None:
    assert {task.name for task in TASKS.values()} == set(DESCRIPTIONS)


def fresh(task: Task, num_envs: int, threads: int = 1) -> Environment:
    env = make_env(task, num_envs, threads)
    env.reset(np.arange(num_envs), np.arange(num_envs) % len(env.goals))
    return env


def random_actions(env: Environment, steps: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, env.num_envs, env.action_size))


def drive(env: Environment, actions: Array) -> list[Step]:
    return [env.step(action) for action in actions]


def motion(steps: list[Step]) -> Array:
    """(T, N, o + 1): everything that is seen and earned, bit by bit."""
    return np.stack([np.concatenate([step.observation, step.reward[:, None]], axis=1) for step in steps])


def test_the_box_is_touched_in_what_follows() -> None:
    env = fresh(TASKS["push"], 7)
    start = env.achieved_goal()
    drive(env, random_actions(env, STEPS))
    assert (np.linalg.norm(env.achieved_goal() - start, axis=1) > 1e-3).sum() >= 3


@pytest.mark.parametrize("threads", [1, 2])
def test_equal_actions_give_equal_motion_bit_for_bit_with_any_number_of_threads(task: Task, threads: int) -> None:
    first, second = fresh(task, 5), fresh(task, 5, threads)
    actions = random_actions(first, STEPS)
    np.testing.assert_array_equal(motion(drive(first, actions)), motion(drive(second, actions)))
    np.testing.assert_array_equal(first.save(np.arange(5)), second.save(np.arange(5)))


def test_a_simulation_depends_neither_on_its_slot_nor_on_its_neighbours(task: Task) -> None:
    crowd, alone = fresh(task, 7), fresh(task, 1)
    slot = len(crowd.goals)  # on the first skill, like the lonely one
    actions = random_actions(crowd, STEPS)
    if slot >= crowd.num_envs:
        slot, alone.desired_goal[:] = 6, crowd.desired_goal[6]
    together, single = drive(crowd, actions), drive(alone, actions[:, [slot]])
    np.testing.assert_array_equal(motion(together)[:, slot], motion(single)[:, 0])


def test_saved_states_have_the_same_future_in_any_slot_of_any_batch(task: Task) -> None:
    env, other = fresh(task, 3), fresh(task, 5)
    drive(env, random_actions(env, STEPS))
    sim_states, seen, places = env.save(np.arange(3)), env.observe(), env.keypoints()
    future = random_actions(env, STEPS, seed=1)
    expected = motion(drive(env, future))[..., :-1]  # the reward follows the slot's goal
    end = env.save(np.arange(3))

    slots, order = np.array([0, 2, 4]), np.array([2, 0, 1])
    drive(other, random_actions(other, 3, seed=2))
    other.restore(slots, sim_states[order])
    np.testing.assert_array_equal(other.observe()[slots], seen[order])
    np.testing.assert_array_equal(other.keypoints()[slots], places[order])
    actions = random_actions(other, STEPS, seed=3)
    actions[:, slots] = future[:, order]
    np.testing.assert_array_equal(motion(drive(other, actions))[:, slots, :-1], expected[:, order])
    np.testing.assert_array_equal(other.save(slots), end[order])


def test_slots_may_be_named_in_any_order(task: Task) -> None:
    env, other = fresh(task, 3), fresh(task, 3)
    drive(env, random_actions(env, STEPS))
    sim_states = env.save(np.array([2, 0, 1]))
    other.restore(np.array([2, 0, 1]), sim_states)
    np.testing.assert_array_equal(other.observe(), env.observe())


def test_an_episode_begun_from_a_saved_state_has_its_clock_at_zero(task: Task) -> None:
    env = fresh(task, 2)
    drive(env, random_actions(env, 5))
    sim_states = env.save(np.array([0]))
    env.reset_to_state(np.array([1]), sim_states, np.array([2]))
    np.testing.assert_array_equal(env.save(np.array([1])), sim_states)
    np.testing.assert_array_equal(env.desired_goal[1], env.goals[2])
    ends = np.stack([step.truncated for step in drive(env, random_actions(env, env.horizon))])
    assert ends.argmax(axis=0).tolist() == [env.horizon - 6, env.horizon - 1]


def test_every_number_that_is_observed_changes_under_random_actions(task: Task) -> None:
    env = fresh(task, 4)
    seen = motion(drive(env, random_actions(env, env.horizon)))
    changes = np.ptp(seen, axis=0) > 1e-4  # in every simulation, but for the place of a box that an arm does not touch
    assert changes.any(axis=0).all() and changes[:, :10].all()


def test_what_is_returned_shares_no_memory_with_the_simulation(task: Task) -> None:
    env, twin = fresh(task, 3), fresh(task, 3)
    actions = random_actions(env, 4)

    def given(step: Step) -> list[Array]:
        places = [env.achieved_goal(), env.keypoints(), env.save(np.arange(3)), *env.recorded_state().values()]
        *arrays, terms = step
        return [*arrays, *terms.values(), env.observe(), env.privileged(), *places]

    for action in actions[:2]:
        twin.step(action)
        for array in given(env.step(action)):  # writing into it must not reach the simulation
            array[...] = True if array.dtype == bool else 7
    np.testing.assert_array_equal(motion(drive(env, actions[2:])), motion(drive(twin, actions[2:])))

    arrays = given(env.step(actions[0]))
    copies = [array.copy() for array in arrays]
    env.step(actions[1])
    for array, copy in zip(arrays, copies, strict=True):  # and the simulation must not write into it
        np.testing.assert_array_equal(array, copy)


def test_a_reset_puts_back_those_named_and_no_other(task: Task) -> None:
    env = fresh(task, 3)
    start = env.save(np.arange(3))
    drive(env, random_actions(env, STEPS))
    moved = env.save(np.arange(3))
    env.reset(np.array([1]), np.array([3]))
    np.testing.assert_array_equal(env.save(np.array([1])), start[[1]])
    np.testing.assert_array_equal(env.save(np.array([0, 2])), moved[[0, 2]])
    np.testing.assert_array_equal(env.desired_goal, env.goals[[0, 3, 2]])


def test_an_episode_ends_by_time_alone_and_never_by_success(task: Task) -> None:
    env = fresh(task, 2)
    env.desired_goal[:] = env.achieved_goal()
    for t, step in enumerate(drive(env, np.zeros((env.horizon, 2, env.action_size))), 1):
        assert (np.linalg.norm(env.achieved_goal() - env.desired_goal, axis=1) <= env.tolerance).all(), "it stays at the goal"
        assert not step.terminated.any()
        assert (step.truncated == (t == env.horizon)).all()


@pytest.mark.parametrize("task", ["point", "reach"], indirect=True)
def test_the_reward_is_minus_the_distance_to_the_goal(task: Task) -> None:
    env = fresh(task, 4)
    for action in random_actions(env, STEPS):
        reward = env.step(action).reward
        np.testing.assert_allclose(reward, -np.linalg.norm(env.achieved_goal() - env.desired_goal, axis=1), rtol=1e-12)


def test_the_reward_follows_the_target_and_not_the_skill(task: Task) -> None:
    env = fresh(task, 2)
    env.desired_goal[:] = env.achieved_goal()
    action = random_actions(env, 1)[0]
    action[1] = action[0]
    np.testing.assert_array_equal(*env.step(action).reward)
    env.desired_goal[1] += [0.1, 0.1, 0]
    assert np.ptp(env.step(action).reward) > 0.01


def test_a_mixture_of_goals_is_asked_of_the_simulations_that_are_named(task: Task) -> None:
    env = fresh(task, 3)
    weights = np.full((2, len(env.goals)), 0.0)
    weights[0, :2], weights[1, 1] = (0.25, 0.75), 1.0
    before = env.desired_goal[1].copy()
    env.mix_goals(np.array([2, 0]), weights)
    np.testing.assert_allclose(env.desired_goal[2], 0.25 * env.goals[0] + 0.75 * env.goals[1])
    np.testing.assert_allclose(env.desired_goal[0], env.goals[1])
    np.testing.assert_array_equal(env.desired_goal[1], before)


def test_landmarks_are_the_judged_point_and_what_else_a_planner_needs(task: Task) -> None:
    env = fresh(task, 3)
    drive(env, random_actions(env, STEPS))
    keypoints = env.keypoints()
    assert keypoints.shape == (3, {"push": 2, "blocks": 3}.get(task.name, 1), 3)
    np.testing.assert_array_equal(keypoints[:, 0], env.achieved_goal())


def test_shapes_and_types(task: Task) -> None:
    env = fresh(task, 3)
    step = env.step(random_actions(env, 1)[0])
    assert step.observation.shape == (3, env.observation_size) and step.observation.dtype == np.float32
    assert step.reward.shape == (3,) and step.terminated.dtype == step.truncated.dtype == bool
    assert env.achieved_goal().shape == (3, 3) and env.goals.shape == (len(task.goals), 3)
    assert env.applied.shape == (3, env.action_size)
    assert env.privileged().shape == (3, env.privileged_size) and env.privileged().dtype == np.float32
    assert len(env.save(np.array([0, 2]))) == 2


def test_actions_are_clipped_to_the_limit(task: Task) -> None:
    full, wild = fresh(task, 2), fresh(task, 2)
    sign = np.sign(random_actions(full, 3))
    np.testing.assert_array_equal(motion(drive(full, sign)), motion(drive(wild, 50 * sign)))
    np.testing.assert_allclose(wild.applied, world(task).action_scale * sign[-1])


def test_single_precision_actions_of_a_network_do_the_same(task: Task) -> None:
    env = fresh(task, 2)
    action = random_actions(env, 1)[0].astype(np.float32)
    assert np.isfinite(env.step(action).observation).all()
    assert env.save(np.arange(2)).dtype == np.float64


def test_a_sighting_leads_another_simulation_the_same_way(task: Task) -> None:
    env, other = fresh(task, 2), fresh(task, 3)
    drive(env, 0.3 * random_actions(env, STEPS))
    seen = env.estimate_state()
    np.testing.assert_allclose(seen.achieved_goal, env.achieved_goal(), atol=1e-6)
    other.set_estimated_state(np.array([2, 1]), seen.state)
    np.testing.assert_allclose(other.keypoints()[[2, 1]], env.keypoints(), atol=1e-3)
    action = np.zeros((3, env.action_size))
    for _ in range(3):
        env.step(action[:2])
        other.step(action)
    moved = np.linalg.norm(other.achieved_goal()[[2, 1]] - env.achieved_goal(), axis=1)
    assert (moved < 0.02).all(), "what moves is seen to move, within what two angles tell about a speed"


ANOTHER = {
    "gain": 1.5, "position_noise": 0.1, "joint_noise": 0.05, "start_offset": 0.1, "latency": 0.05, "object_size": 1.2,
    "control_jitter": 0.05, "joint_drift": 0.05, "drift_time": 1.0, "push_rate": 20.0, "arm_push": 5.0,
}  # fmt: skip


def another(num_envs: int) -> dict[str, Array]:
    sizes = {name: width(name) for name in ANOTHER}
    return {name: np.full(num_envs if sizes[name] == 1 else (num_envs, sizes[name]), value) for name, value in ANOTHER.items()}


def test_a_robot_that_becomes_nominal_again_does_as_one_that_always_was(task: Task) -> None:
    env, plain = make_env(task, 3, 1, delay=True), make_env(task, 3, 1, delay=True)
    actions = random_actions(env, STEPS)
    for names in (ANOTHER, ["gain"], ["position_noise"]):
        env.randomize({name: values for name, values in another(3).items() if name in names}, np.random.default_rng(0))
        env.reset(np.arange(3), np.zeros(3, dtype=np.int64))
        drive(env, actions)
        env.randomize({}, np.random.default_rng(0))
        for each in (env, plain):
            each.reset(np.arange(3), np.zeros(3, dtype=np.int64))
        np.testing.assert_array_equal(motion(drive(env, actions)), motion(drive(plain, actions)))


def test_chance_of_each_hangs_neither_on_how_many_there_are_nor_on_what_differs_there(task: Task) -> None:
    actions = random_actions(fresh(task, 4), STEPS)

    def seen(num_envs: int, **first: float) -> Array:
        env, parameters = make_env(task, num_envs, 1, delay=True), another(num_envs)
        for name, value in first.items():
            parameters[name][0] = value
        env.randomize(parameters, [np.random.default_rng(simulation) for simulation in range(num_envs)])
        env.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))
        return motion(drive(env, actions[:, :num_envs]))

    four = seen(4)
    np.testing.assert_array_equal(seen(2), four[:, :2])
    np.testing.assert_array_equal(
        seen(4, joint_noise=0.0, joint_drift=0.0, push_rate=0.0, control_jitter=0.0)[:, 1:], four[:, 1:]
    )
    assert (np.ptp(four - four[:, :1], axis=0).max(axis=1)[1:] > 1e-3).all(), "and it differs from one to the other"


@pytest.mark.parametrize("gain", [1.0, 0.02])
def test_actions_as_applied_lead_the_same_way_again(task: Task, gain: float) -> None:
    """What is stored is how far the commanded target moved, whatever held it back: an arm that lags, or its joint range."""
    if isinstance(task, BlocksTask) and gain < 1:
        gain /= 4  # the Panda's last joint has less friction
    env, again = fresh(task, 2), fresh(task, 2)
    for each in (env, again):
        each.randomize({"gain": np.full((2, 7), gain)}, np.random.default_rng(0))
        each.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    limit, arms, last = task.action_scale, getattr(env, "arms", None), env.joints - 1 if task.name != "point" else 1
    begun = None if arms is None else arms.commanded.copy()
    action = np.zeros((2, env.action_size))
    action[:, last] = 50.0  # the last joint, or y, to its end
    path, applied = [], []
    for _ in range(8000 if arms is None else 130):
        path.append(env.step(action).observation)
        applied.append(env.applied)
    moves = np.stack(applied)[:, :, last]
    assert moves[0] == pytest.approx(limit) and moves.min() >= 0 and moves[-1] == pytest.approx(0, abs=1e-9), "it is at its end"
    if arms is not None:
        np.testing.assert_allclose(begun + np.sum(applied, axis=0)[:, : env.joints], arms.commanded, atol=1e-9)
        lagging = (moves > 1e-6) & (moves < 0.9 * limit)
        assert lagging.sum() >= 10 if gain < 1 else lagging.sum() <= 2, "a weak servo holds its own target back"
    np.testing.assert_allclose([again.step(one / world(task).action_scale).observation for one in applied], path, atol=1e-6)


def test_commands_under_way_are_part_of_a_sighting() -> None:
    late = {"latency": np.array([0.1])}
    env, other = make_env(ReachTask(), 1, delay=True), make_env(ReachTask(), 1, delay=True)
    for each in (env, other):
        each.randomize(late, np.random.default_rng(0))
        each.reset(np.array([0]), np.array([0]))
    env.step(np.full((1, 7), 0.5))
    env.step(np.full((1, 7), 0.5))
    np.testing.assert_allclose(env.achieved_goal(), other.achieved_goal(), atol=2e-3, err_msg="nothing has arrived yet")
    other.set_estimated_state(np.array([0]), env.estimate_state().state)
    for _ in range(6):
        env.step(np.zeros((1, 7)))
        other.step(np.zeros((1, 7)))
    np.testing.assert_allclose(env.achieved_goal(), other.achieved_goal(), atol=3e-3)


def test_the_lead_of_the_command_is_seen_where_the_task_says_so() -> None:
    plain, seeing = make_env(ReachTask(), 2), make_env(ReachTask(observe_command=True), 2)
    assert (plain.observation_size, seeing.observation_size) == (10, 17)
    before = seeing.observe()
    np.testing.assert_allclose(before[:, 10:], 0, atol=1e-6)
    step = seeing.step(np.full((2, 7), 0.5))
    lead = 0.5 * 0.04 - (step.observation[:, :7] - before[:, :7])
    np.testing.assert_allclose(step.observation[:, 10:], lead, atol=1e-6)
    assert (lead[:, :4] > 0.005).all(), "servos lag"


def test_a_task_that_nobody_registered_is_no_other_task() -> None:
    class Plain(ArmTask):
        name: str = "plain"
        goals: tuple[tuple[float, float], ...] = ((0.5, 0.0),)
        names: tuple[str, ...] = ()

    for use in (lambda: make_env(Plain(), 1), lambda: model_of(Plain()), lambda: goal_place(Plain(), (0.5, 0.0))):
        with pytest.raises(UsageError, match="no task 'plain'"):
            use()
