"""Episodes of a learned composer in the plane, with a composer that learns nothing: what it is shown and told."""

from __future__ import annotations

import numpy as np
from plane import ORIGIN, Plane

from skillcli.composition.episodes import FAILED, Episodes, EpisodeSettings, Moment
from skillcli.composition.planner import run
from skillcli.composition.route import Route
from skillcli.trajectories import Array


class Scripted:
    """Chooses velocity (1, 0) for everybody but the last episode, which goes the other way; remembers what it hears."""

    def __init__(self, speeds: tuple[float, ...] = (1.0,)) -> None:
        self.speeds, self.round = speeds, 0
        self.features: list[Array] = []
        self.rewards: list[Array] = []
        self.terminated: list[Array] = []
        self.valid: list[Array] = []

    def act(self, features: Array) -> Array:
        if not self.features:
            self.features.append(features)
        latent = np.zeros((len(features), 2))
        latent[:, 0] = self.speeds[min(self.round, len(self.speeds) - 1)]
        latent[-1, 0] = -1
        return latent

    def observe(self, reward: Array, features: Array, terminated: Array) -> None:
        self.rewards.append(reward)
        self.features.append(features)
        self.terminated.append(terminated)

    def update(self, valid: Array) -> dict[str, float]:
        self.round += 1
        self.valid.append(valid)
        return {"round": float(self.round)}

    def arrays(self) -> dict[str, Array]:
        return {"round": np.array(self.round)}


def episodes(composer: Scripted, rounds: int = 1, good_enough: float = 0.0) -> Episodes:
    settings = EpisodeSettings(goal_tolerance=0.01, good_enough=good_enough, reward_scale=10.0, iterations=rounds)
    route = Route(np.array([[4.0, 0, 0]]), tolerance=0.1)
    start = Moment(np.tile(ORIGIN, (3, 1)), np.tile(ORIGIN, (3, 1, 1)), np.tile(ORIGIN[:2], (3, 1)))
    return Episodes(start, route, composer, steps=2, segments=3, settings=settings)


def rollout(planner: Episodes, world: Plane | None = None) -> Episodes:
    run(planner, world or Plane(), lambda *_: None)  # type: ignore[arg-type]
    return planner


def test_rewards_are_the_metres_left_on_average_and_an_episode_is_over_where_it_arrives() -> None:
    composer = Scripted()
    planner = rollout(episodes(composer))
    assert np.stack(composer.rewards[:2]).tolist() == [[-25, -25, -55], [-5, -5, -75]] and composer.rewards[2][2] == -95
    assert composer.valid[0].tolist() == [[True, True, True], [True, True, True], [False, False, True]]
    assert np.stack(composer.terminated).tolist() == [[False] * 3, [True, True, False], [False] * 3]
    seen = np.stack(composer.features)[:, 1]
    assert seen[:2].tolist() == [[0, 0, -4, 0, 0], [2, 0, -2, 0, 0]]
    assert planner.curves["arrived"] == [2 / 3] and planner.curves["env_steps"] == [2 * (2 + 2 + 3)]
    assert planner.curves["return"] == [(-30 - 225) / 2] and planner.curves["greedy_return"] == [-30]


def test_the_plan_ends_the_moment_it_arrives() -> None:
    planner = rollout(episodes(Scripted(speeds=(0.8,))))
    assert [segment.steps for segment in planner.plan()] == [2, 2, 1] and planner.merit == (0, 0.01, 5)


def test_the_best_plan_of_the_first_episode_is_kept_with_its_weights() -> None:
    composer = Scripted(speeds=(0.5, 0.7, 0.1))
    planner = rollout(episodes(composer, rounds=3))
    assert [segment.latent[0] for segment in planner.plan()] == [0.7] * 3 and planner.weights["round"] == 1
    np.testing.assert_allclose(planner.curves["greedy_final_distance"], [1.0, 0.2, 3.4])
    assert planner.curves["env_steps"] == [18, 36, 54] and planner.curves["round"] == [1, 2, 3]


def test_who_arrives_sooner_is_better() -> None:
    planner = rollout(episodes(Scripted(speeds=(0.8, 1.0, 0.8)), rounds=3))
    assert planner.merit == (0, 0.01, 4) and planner.weights["round"] == 1


def test_learning_ends_once_it_is_good_enough() -> None:
    composer = Scripted(speeds=(0.5, 0.7, 0.1))
    assert rollout(episodes(composer, rounds=3, good_enough=0.25)).done[0] == 2


def test_a_failed_episode_counts_once_and_is_over() -> None:
    composer = Scripted()
    planner = rollout(episodes(composer), Plane(lambda path: path[..., 0] > -3))
    assert np.stack(composer.terminated)[:, 2].tolist() == [False, True, False]
    assert composer.valid[0][:, 2].tolist() == [True, True, False]
    assert composer.rewards[1][2] == -10 * FAILED
    assert composer.features[-1][2].tolist() == [0, 0, -4, 0, 0], "back at the start, not in the broken state"
    assert planner.curves["return"] == [(-30 - 55 - 50) / 2], "the first episode is not counted"


def test_a_first_episode_that_fails_gives_no_plan() -> None:
    planner = rollout(episodes(Scripted()), Plane(lambda path: path[..., 0] < 3))
    assert planner.plan() == [] and planner.weights == {}
