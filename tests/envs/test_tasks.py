import numpy as np
import pytest

from skillcli.envs import sawyer
from skillcli.envs.reach import ReachEnvironment
from skillcli.envs.tasks import COMPOSITIONS, check_goal, model_fingerprint, named_waypoints
from skillcli.envs.throughput import BareEngine
from skillcli.errors import UsageError
from skillcli.recipe import PointTask, ReachTask

REACH, POINT = ReachTask(), PointTask()


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
    ],
)
def test_other_goals_are_refused_with_a_hint(task: ReachTask | PointTask, goal: tuple[float, ...], said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        check_goal(task, np.array(goal, dtype=float))
    assert caught.value.hint


def test_no_arm_posture_reaches_beyond_what_is_said_to_be_the_longest_reach() -> None:
    env = ReachEnvironment(REACH, 256)
    rng = np.random.default_rng(0)
    env.arms.place(np.arange(256), rng.uniform(env.arms.model.jnt_range[:7, 0], env.arms.model.jnt_range[:7, 1], (256, 7)))
    reach = np.linalg.norm(env.judged() - sawyer.SHOULDER, axis=1)
    assert reach.max() <= sawyer.LONGEST_REACH and reach.max() > 0.8 * sawyer.LONGEST_REACH


@pytest.mark.parametrize("task", [REACH, POINT])
def test_every_named_composition_can_be_reached(task: ReachTask | PointTask) -> None:
    for name in COMPOSITIONS[task.name]:
        for goal in named_waypoints(task, name):
            check_goal(task, goal)


def test_an_unknown_composition_names_those_there_are() -> None:
    with pytest.raises(UsageError, match="no composition 'circle'") as caught:
        named_waypoints(REACH, "circle")
    assert "triangle" in caught.value.hint


def test_the_model_fingerprint_is_stable_and_follows_the_model() -> None:
    assert model_fingerprint(REACH) == model_fingerprint(ReachTask(horizon=5)) != ""
    assert model_fingerprint(REACH) != model_fingerprint(ReachTask(timestep=0.01))


def test_measuring_the_bare_engine_leaves_the_simulations_as_they_were() -> None:
    env = ReachEnvironment(REACH, 4)
    env.step(np.random.default_rng(0).uniform(-1, 1, (4, 7)))
    before, seen = env.save(np.arange(4)), env.observe()
    bare = BareEngine(env)
    assert bare.rate is None
    bare.measure()
    assert bare.rate is not None and bare.rate > 0
    np.testing.assert_array_equal(env.save(np.arange(4)), before)
    np.testing.assert_array_equal(env.observe(), seen)
