"""Episodes that ended badly begin again."""

from __future__ import annotations

import numpy as np
import pytest
from test_learner import RECIPE, learner, run
from worlds import make_env

from skillcli.learning.mixtures import MIXED
from skillcli.learning.rollout import collect
from skillcli.learning.worst import MOST, WorstEpisodes
from skillcli.recipe import resolve
from skillcli.tasks.point.settings import PointTask

RNG = np.random.default_rng(0)


def test_the_worst_quarter_of_a_rollout_is_kept_for_sixteen_rollouts() -> None:
    worst = WorstEpisodes(8)
    for rollout in range(17):
        distance = np.array([0.1, 0.5, np.inf, 0.2, 0.3, 0.0, 0.4, 0.1])
        worst.keep(100.0 * rollout + np.arange(8.0)[:, None], np.arange(8), np.eye(8), distance)
    assert worst.filled == worst.capacity == 2 * 16
    sim_states, skill, weights = worst.draw(1000, RNG)
    assert set(sim_states.ravel()) == {100.0 * rollout + each for rollout in range(1, 17) for each in (1, 2)}, "lost ones first"
    assert skill.dtype == np.int64 and (sim_states.ravel() % 100 == skill).all() and (weights.argmax(axis=1) == skill).all()


def test_repeated_episodes_begin_in_the_same_state_with_the_same_goal() -> None:
    recipe = resolve(RECIPE.model_dump(mode="json"), [f"training.repeat_worst={MOST}", "mixtures.share=0.5"])
    trained = run(learner(num_envs=40, recipe=recipe), 2)
    assert trained.worst is not None and trained.worst.filled == 20
    states, skills, weights = (column[:20].copy() for column in trained.worst.columns)
    assert len({*map(tuple, states)}) > 5, "some began where others passed"
    rollout = collect(
        trained.env, trained.agent, trained.pool, 0.0, trained.rng, trained.mixer, False, None, trained.worst, 1.0
    )
    assert rollout.repeated.all()
    begun = rollout.observation[0, :, :2]  # a point sees its place
    for skill, place, mixture in zip(rollout.skill, begun, rollout.weights, strict=True):
        found = np.isclose(weights, mixture, atol=1e-5).all(axis=1) & np.isclose(states[:, :2], place, atol=1e-5).all(axis=1)
        assert found.any() and (skill == MIXED) == (mixture.max() < 1)
        assert skill == MIXED or skill in skills[found]
    np.testing.assert_allclose(trained.env.desired_goal, rollout.weights @ trained.env.goals, atol=1e-5)


def test_what_an_episode_repeats_is_its_share_and_the_curves_leave_it_out() -> None:
    recipe = resolve(RECIPE.model_dump(mode="json"), [f"training.repeat_worst={MOST}"])
    trained = run(learner(num_envs=400, recipe=recipe), 1)
    rollout = collect(
        trained.env, trained.agent, trained.pool, 0.0, trained.rng, trained.mixer, False, None, trained.worst, MOST
    )
    assert float(rollout.repeated.mean()) == pytest.approx(MOST, abs=0.06)
    near = rollout.final_distance <= recipe.task.tolerance
    rates = trained._outcome(rollout)
    assert rates["success_rate"] == pytest.approx(near[~rollout.repeated].mean())


def test_without_it_nothing_is_kept_and_no_chance_is_spent() -> None:
    first, again = learner(), learner(recipe=resolve(RECIPE.model_dump(mode="json"), ["training.repeat_worst=0.0"]))
    assert first.worst is None and again.worst is None
    assert run(first, 2).curves == run(again, 2).curves
    env = make_env(PointTask(), 4)
    assert not collect(env, first.agent, first.pool, 0.0, first.rng).repeated.any()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda arrays, state: state.pop("worst"), "its state lacks or should not have"),
        (lambda arrays, state: state.update(worst=[1]), "worst must be two whole numbers"),
        (lambda arrays, state: state.update(worst=[900, 0]), "worst cannot have 900 states"),
        (lambda arrays, state: arrays.pop("worst/skill"), "worst/skill is missing"),
        (lambda arrays, state: arrays.update({"worst/skill": arrays["worst/skill"] + 9}), "worst/skill names a skill"),
        (lambda arrays, state: arrays.update({"worst/weights": arrays["worst/weights"] * 2}), "worst/weights are no shares"),
        (lambda arrays, state: arrays.update({"worst/sim_states": arrays["worst/sim_states"][:1]}), "worst/sim_states holds"),
    ],
)
def test_a_checkpoint_with_worst_episodes_that_cannot_be_is_refused(change, told) -> None:  # type: ignore[no-untyped-def]
    recipe = resolve(RECIPE.model_dump(mode="json"), ["training.repeat_worst=0.2"])
    arrays, state = run(learner(recipe=recipe), 3).state()
    change(arrays, state)
    with pytest.raises(ValueError, match=told):
        learner(recipe=recipe).load(arrays, state)
