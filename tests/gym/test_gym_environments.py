"""Gymnasium environments: the rules of the interface, seeds, ends, and that they are the engine's own episodes."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import skillcli
import skillcli.gym as registered
from skillcli.composition.episodes import EpisodeSettings, Moment, Round
from skillcli.composition.route import Route
from skillcli.errors import UsageError
from skillcli.gym.latent_episodes import LatentEpisodes
from skillcli.recipe import load_recipe
from skillcli.tasks.registry import ROOMS
from skillcli.tasks.world import World

REFERENCE = Path(skillcli.__file__).parents[1] / "artifacts"
LIBRARY = {"library": "reference-reach/embed-means", "store": REFERENCE}
IDS = [registered.task_id(task, goal) for task in ROOMS for goal in (False, True)]
ALL = [*((name, {}) for name in IDS), (registered.LATENT, LIBRARY)]


def make(name: str, **kwargs: Any) -> Any:
    return gymnasium.make(name, **kwargs).unwrapped


@pytest.mark.parametrize(("name", "kwargs"), ALL, ids=[name for name, _ in ALL])
def test_the_checkers_of_gymnasium_and_stable_baselines_have_nothing_to_say(name: str, kwargs: dict[str, Any]) -> None:
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gymnasium.make(name, **kwargs)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        check_env(env.unwrapped)
        sb3.check_env(env.unwrapped)


def test_every_task_is_registered_under_its_name() -> None:
    assert IDS == [
        "skill/Point-v0",
        "skill/PointGoal-v0",
        "skill/Reach-v0",
        "skill/ReachGoal-v0",
        "skill/Push-v0",
        "skill/PushGoal-v0",
        "skill/Blocks-v0",
        "skill/BlocksGoal-v0",
    ]
    assert {*IDS, "skill/Latent-v0"} <= gymnasium.registry.keys()
    assert registered.task_id("pick_and-place") == "skill/PickAndPlace-v0"


def test_one_environment_is_the_engines_own_episode() -> None:
    env, actions = make("skill/Reach-v0"), np.random.default_rng(0).uniform(-1, 1, (20, 7)).astype(np.float32)
    observation, info = env.reset(seed=3)
    world = World.of(load_recipe("reach"))
    engine = world.make_env(1)
    engine.reset(np.arange(1), np.zeros(1, dtype=int))
    engine.desired_goal[:] = info["goal"]
    assert observation[:10] == pytest.approx(engine.observe()[0]) and observation[10:] == pytest.approx(
        info["goal"] - observation[7:10]
    )
    for action in actions:
        expected = engine.step(action[None].astype(float))
        observation, reward, terminated, truncated, info = env.step(action)
        assert np.array_equal(observation[:10], expected.observation[0]) and reward == expected.reward[0]
        assert info["distance"] == pytest.approx(-reward) and not terminated and not truncated


def test_a_seed_gives_the_same_episodes_and_no_seed_goes_on() -> None:
    env = make("skill/Reach-v0")
    first = [env.reset(seed=5)[1]["goal"], *(env.reset()[1]["goal"] for _ in range(2))]
    again = [env.reset(seed=5)[1]["goal"], *(env.reset()[1]["goal"] for _ in range(2))]
    assert np.array_equal(first, again) and len(np.unique(first, axis=0)) == 3
    low, high = env.episodes.world.goals.min(axis=0), env.episodes.world.goals.max(axis=0)
    assert (np.array(first) >= low).all() and (np.array(first) <= high).all()
    assert not np.array_equal(env.reset(seed=6)[1]["goal"], first[0])


def test_environment_i_of_many_is_the_one_of_seed_plus_i_over_several_episodes() -> None:
    settings = ("task.horizon=5",)
    many = gymnasium.make_vec("skill/Reach-v0", num_envs=3, settings=settings)
    single = [make("skill/Reach-v0", settings=settings) for _ in range(3)]
    observations, _ = many.reset(seed=7)
    alone = np.array([env.reset(seed=7 + i)[0] for i, env in enumerate(single)])
    assert np.array_equal(observations, alone)
    rng, over = np.random.default_rng(1), False
    for _ in range(13):
        actions = rng.uniform(-1, 1, (3, 7))
        observations, rewards, terminated, truncated, infos = many.step(actions)
        if over:  # the step after an end resets
            alone, expected, over = np.array([env.reset()[0] for env in single]), np.zeros(3), False
            assert not truncated.any() and not infos["_distance"].any()
        else:
            results = [env.step(action) for env, action in zip(single, actions, strict=True)]
            alone, expected = np.array([r[0] for r in results]), np.array([r[1] for r in results])
            assert truncated.tolist() == [r[3] for r in results]
            over = bool(truncated.all())
        assert np.array_equal(observations, alone) and np.array_equal(rewards, expected) and not terminated.any()


def test_episodes_that_end_apart_are_reset_apart() -> None:
    many = gymnasium.make_vec("skill/Reach-v0", num_envs=2, settings=("task.horizon=6",))
    many.reset(seed=0)
    many.unwrapped.episodes.env._elapsed[1] = 3  # as if it had begun earlier
    ends = [many.step(np.full((2, 7), 0.3))[3].tolist() for _ in range(9)]
    assert ends == [[False, False]] * 2 + [[False, True]] + [[False, False]] * 2 + [[True, False]] + [[False, False]] * 3
    assert many.unwrapped.episodes.env._elapsed.tolist() == [2, 5]


def test_a_failure_terminates_and_is_no_time_out() -> None:
    env = make("skill/Push-v0")
    env.reset(options={"goal": (0.0, 0.0)})  # where the box is, and where the engine puts it back
    env.episodes.env.arms.object_poses[0] = [0.6, 0, 3.0, 1, 0, 0, 0]
    _, reward, terminated, truncated, info = env.step(np.zeros(7))
    assert terminated and not truncated and reward == -30.0 and not info["is_success"]


@pytest.mark.parametrize("task", ["Point", "Reach", "Push"])
def test_time_truncates_with_the_horizon_of_the_recipe(task: str) -> None:
    env = make(f"skill/{task}-v0", settings=("task.horizon=4",))
    env.reset(seed=0)
    ends = [env.step(np.zeros(env.action_space.shape))[2:4] for _ in range(4)]
    assert ends == [(False, False)] * 3 + [(False, True)]


def test_rewards_of_goals_are_recomputed_for_many_at_once() -> None:
    env = make("skill/ReachGoal-v0")
    observation, _ = env.reset(options={"skill": 2})
    assert observation["desired_goal"] == pytest.approx(env.episodes.world.goals[2])
    observation, reward, *_ = env.step(np.zeros(7))
    achieved = np.stack(
        [observation["achieved_goal"], observation["desired_goal"] + [0.049, 0, 0], observation["desired_goal"] + [0.051, 0, 0]]
    )
    rewards = env.compute_reward(achieved, np.tile(observation["desired_goal"], (3, 1)), [{}] * 3)
    assert rewards.tolist() == [reward, 1.0, 0.0] and reward == 0.0
    assert env.compute_reward(observation["desired_goal"], observation["desired_goal"], {}) == 1.0


def test_other_arms_by_name_and_recipes_by_name() -> None:
    env = make("skill/Reach-v0", robot="ur5e")
    assert env.action_space.shape == (6,) and env.observation_space.shape == (6 + 3 + 3,)
    assert make("skill/Reach-v0", recipe="reach-so101").action_space.shape == (5,)
    assert make("skill/Push-v0", recipe="push").observation_space.shape == (7 + 3 + 2 + 3,)
    with pytest.raises(UsageError, match="is of the push task, not of reach"):
        make("skill/Reach-v0", recipe="push")


@pytest.mark.parametrize(
    "options", [{"goal": (5.0, 0.0, 0.2)}, {"goal": (0.6, 0.0)}, {"skill": 8}, {"skill": 1, "goal": (0.6, 0, 0.2)}, {"aim": 1}]
)
def test_goals_of_a_reset_are_checked(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        make("skill/Reach-v0").reset(options=options)


@pytest.mark.parametrize("action", [np.zeros(6), np.zeros((1, 7)), np.full(7, np.nan)])
def test_wrong_actions_are_refused(action: Any) -> None:
    env = make("skill/Reach-v0")
    env.reset(seed=0)
    with pytest.raises(UsageError, match="action"):
        env.step(action)


def test_a_latent_is_held_for_a_segment_as_composers_hold_it() -> None:
    library = skillcli.load(LIBRARY["library"], REFERENCE)._library
    settings = library.recipe.settings_of("ppo")
    assert isinstance(settings, EpisodeSettings)
    ours, goal = LatentEpisodes(library, settings, 2, 1), np.array([0.6, 0.1, 0.25])
    ours.begin(np.arange(2), np.tile(goal, (2, 1)))
    route = Route(goal[None], settings.goal_tolerance)
    theirs = Round(Moment.start(ours._world, 2), route, settings, 5)
    assert ours.observe() == pytest.approx(theirs.features, abs=1e-6)
    rng = np.random.default_rng(0)
    for _ in range(3):
        action = rng.uniform(-1, 1, (2, 3))
        outcome = ours._world.hold(theirs.now.sim_states, ours.bounds.latent(action), 5)
        reward, terminated = theirs.advance(ours.bounds.latent(action), outcome)
        played = ours.step(action, None)
        assert played.reward == pytest.approx(reward) and np.array_equal(played.terminated, terminated)
        assert ours.observe() == pytest.approx(theirs.features, abs=1e-6)


def test_the_mean_latent_of_a_skill_meets_its_goal() -> None:
    env = make(registered.LATENT, **LIBRARY, seconds=3.0)
    env.reset(options={"skill": 3})
    action = env.episodes.bounds.unit(skillcli.load(LIBRARY["library"], REFERENCE).skills[3].mean)
    results = [env.step(action)]
    while not results[-1][2] and not results[-1][3]:
        results.append(env.step(action))
    _, reward, terminated, truncated, info = results[-1]
    assert terminated and not truncated and info["is_success"] and info["distance"] <= 0.02 and reward > results[0][1]
