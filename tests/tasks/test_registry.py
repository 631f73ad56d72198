import numpy as np
import pytest
from worlds import SAWYER, check_goal, check_start, model_fingerprint, named_routes, reach_env

from skillcli.errors import UsageError
from skillcli.simulation.settings import TaskSettings as Task
from skillcli.simulation.throughput import STEPS, BareEngine
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.cost_to_go import BoxCostToGo
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.registry import cost_to_go, find_task
from skillcli.tasks.world import place_goal as goal_place
from skillcli.tasks.world import skill_goals

REACH, POINT, PUSH = ReachTask(), PointTask(), PushTask()


@pytest.mark.parametrize("goal", [*REACH.goals, (0.6, 0, 0.0), (-0.5, 0.5, 0.6), (0, 0, 1.6)])
def test_goals_within_reach_are_taken(goal: tuple[float, ...]) -> None:
    check_goal(REACH, np.array(goal, dtype=float))


@pytest.mark.parametrize(
    ("task", "goal", "said"),
    [
        (REACH, (np.nan, 0, 0.2), "not finite"),
        (REACH, (0.6, np.inf, 0.2), "not finite"),
        (REACH, (2.0, 0, 0.2), "out of reach"),
        (REACH, (0, 0, 1.7), "out of reach"),
        (REACH, (0.6, 0, -0.01), "below the table"),
        (POINT, (5.1, 0, 0), "out of bounds"),
        (POINT, (0, np.nan, 0), "not finite"),
        (PUSH, (np.nan, 0, 0), "not finite"),
        (PUSH, (0.6, 0.58, 0), "no room for the box"),
        (PUSH, (1.12, 0, 0), "no room for the box"),
        (PUSH, (0.32, 0, 0), "no room for the box"),
    ],
)
def test_other_goals_are_refused_with_a_hint(task: Task, goal: tuple[float, ...], said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        check_goal(task, np.array(goal, dtype=float))
    assert caught.value.hint


def test_no_arm_posture_reaches_beyond_what_is_said_to_be_the_longest_reach() -> None:
    env = reach_env(REACH, 256)
    rng = np.random.default_rng(0)
    env.arms.reset_to(np.arange(256), rng.uniform(env.arms.model.jnt_range[:7, 0], env.arms.model.jnt_range[:7, 1], (256, 7)))
    reach = np.linalg.norm(env.achieved_goal() - np.array(SAWYER.workspace.shoulder), axis=1)
    assert reach.max() <= SAWYER.workspace.reach and reach.max() > 0.8 * SAWYER.workspace.reach


@pytest.mark.parametrize("task", [REACH, POINT, PUSH])
def test_every_named_composition_and_every_skill_can_be_reached(task: Task) -> None:
    assert find_task(task.name).compositions
    for name in find_task(task.name).compositions:
        for goal in np.concatenate(named_routes(task, name)):
            check_goal(task, goal)
    for goal in skill_goals(task):
        check_goal(task, goal)


def test_a_composition_has_one_route_or_several() -> None:
    (route,) = named_routes(REACH, "triangle")
    assert route.shape == (4, 3) and route[0].tolist() == route[-1].tolist() == [0.6, 0.3, 0.15]
    (route,) = named_routes(POINT, "triangle")
    assert route.tolist() == [[2, 1, 0], [-2, 1, 0], [0, -2, 0]]


def test_the_ring_is_twelve_pushes_all_round_outside_the_square_of_the_skills() -> None:
    routes = named_routes(PUSH, "ring")
    assert [route.shape for route in routes] == [(1, 3)] * 12
    place = np.concatenate(routes)
    away = place[:, :2] - PUSH.box_start
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.2, atol=1e-4)
    np.testing.assert_allclose(np.degrees(np.arctan2(away[:, 1], away[:, 0])) % 360, np.arange(0, 360, 30), atol=0.05)
    assert (place[:, 2] == 0).all() and np.abs(away).sum(axis=1).min() > 0.15, "the square has its corners at 0.15 m"


@pytest.mark.parametrize(
    ("task", "goal", "place"),
    [
        (POINT, (1, 2), [1, 2, 0]),
        (REACH, (0.6, 0.1, 0.2), [0.6, 0.1, 0.2]),
        (PUSH, (0.1, -0.1), [0.7, -0.1, 0]),
        (PushTask(box_start=(0.5, 0.2)), (0, -0.05), [0.5, 0.15, 0]),
    ],
)
def test_a_goal_is_a_place_and_for_a_push_a_displacement_of_the_box(
    task: Task, goal: tuple[float, ...], place: list[float]
) -> None:
    assert goal_place(task, goal) == pytest.approx(place)
    for wrong in (goal[:-1], (*goal, 0.0)):
        with pytest.raises(UsageError, match=f"has {len(goal)} numbers, got {len(wrong)}") as caught:
            goal_place(task, wrong)
        assert "--goal" in caught.value.hint


def test_only_a_box_has_more_to_go_than_its_distance() -> None:
    assert cost_to_go(PUSH) == BoxCostToGo((0.03, 0.03))
    assert cost_to_go(PushTask(box_size=(0.1, 0.2, 0.05))) == BoxCostToGo((0.05, 0.1))
    assert cost_to_go(REACH) is cost_to_go(POINT) is None


def test_a_box_has_to_start_on_the_table_wherever_it_is_drawn() -> None:
    check_start(PUSH, -0.12, 0.12)
    check_start(PUSH, 0.0, 0.4)  # to one side only
    check_start(REACH, -9.0, 9.0)
    for start, low, high in ((0.2, 0.0, 0.0), (0.4, -0.12, 0.12), (0.9, 0.0, 0.3)):
        with pytest.raises(UsageError, match="starts off the table") as caught:
            check_start(PushTask(box_start=(start, 0)), low, high)
        assert "(0.33, -0.57) .. (1.11, 0.57)" in str(caught.value.hint)


def test_an_unknown_composition_names_those_there_are() -> None:
    with pytest.raises(UsageError, match="no composition 'circle'") as caught:
        named_routes(REACH, "circle")
    assert "triangle" in caught.value.hint


def test_the_model_fingerprint_is_stable_and_follows_the_model() -> None:
    assert model_fingerprint(REACH) == model_fingerprint(ReachTask(horizon=5)) != ""
    assert model_fingerprint(REACH) != model_fingerprint(ReachTask(timestep=0.01))
    heavier = (PushTask(box_mass=0.5), PushTask(box_size=(0.05, 0.06, 0.06)), PushTask(friction=0.5))
    assert len({model_fingerprint(task) for task in (REACH, PUSH, *heavier)}) == 5
    assert model_fingerprint(PUSH) == model_fingerprint(PushTask(goals=((0.1, 0), (0, 0.1)), names=("a", "b")))
    assert model_fingerprint(POINT) == ""


def test_measuring_the_bare_engine_leaves_the_simulations_as_they_were() -> None:
    env, rng = reach_env(REACH, 4), np.random.default_rng(0)
    bare = BareEngine(env)
    bare.measure()
    assert bare.rate is None, "nothing was watched"
    bare.watch()
    for _ in range(env.horizon):
        env.step(rng.uniform(-1, 1, (4, 7)))
    before, seen = env.save(np.arange(4)), env.observe()
    bare.measure()
    assert bare.rate is not None and bare.rate > 0 and bare.control_steps == 4 * STEPS
    np.testing.assert_array_equal(env.save(np.arange(4)), before)
    np.testing.assert_array_equal(env.observe(), seen)
