"""Mixtures of skills in training: weights, latents and ratios by hand, and a training that has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from worlds import make_env

from skillcli.errors import UsageError
from skillcli.learning import gaussian, te_ppo
from skillcli.learning.learner import Learner
from skillcli.learning.mixtures import MIXED, UNMIXED, Mixer
from skillcli.learning.rollout import collect
from skillcli.learning.saved import OF_MIXTURES, curve_names
from skillcli.learning.settings import Mixtures
from skillcli.recipe import Recipe, load_recipe
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.world import skill_goals

SQUARE = skill_goals(PointTask())  # (0, 3), (3, 0), (0, -3), (-3, 0): a square on its tip
TINY = ("training.iterations=6", "training.simulations=8", "training.minibatch=20", "training.epochs=3", "task.horizon=10")
MIXED_RECIPE = load_recipe("point", [*TINY, "mixtures.share=0.5", "mixtures.span=[0.3, 0.9]"])


def learner(recipe: Recipe = MIXED_RECIPE, num_envs: int = 8) -> Learner:
    return Learner(make_env(recipe.task, num_envs), recipe, 0)


def drawn(count: int, goals: np.ndarray = SQUARE, **settings: Any) -> np.ndarray:
    return Mixer.of(Mixtures(share=0.5, **settings), goals, tuple(range(len(goals)))).draw(count, np.random.default_rng(0))


@pytest.mark.parametrize("weights", ["multilinear", "neighbours", "dirichlet"])
def test_weights_are_shares(weights: str) -> None:
    found = drawn(500, weights=weights)
    assert found.shape == (500, 4) and (found >= 0).all()
    np.testing.assert_allclose(found.sum(axis=1), 1)
    np.testing.assert_allclose(found.mean(axis=0), 1 / 4, atol=0.04)


def test_multilinear_weights_fill_the_cuboid_evenly() -> None:
    places = drawn(4000, weights="multilinear") @ SQUARE
    np.testing.assert_allclose(places.mean(axis=0), 0, atol=0.1)
    # the square with corners half as far out holds a quarter of its area
    assert (np.abs(places).sum(axis=1) < 1.5).mean() == pytest.approx(1 / 4, abs=0.03)


def test_neighbours_are_mixed_along_the_sides_of_a_square_and_not_across() -> None:
    found = drawn(200, weights="neighbours")
    assert ((found > 0).sum(axis=1) == 2).all()
    assert not ((found[:, 0] > 0) & (found[:, 2] > 0)).any() and not ((found[:, 1] > 0) & (found[:, 3] > 0)).any()


def test_a_small_concentration_leaves_most_to_one_skill() -> None:
    largest = [drawn(500, concentration=concentration).max(axis=1).mean() for concentration in (0.05, 0.5, 50.0)]
    assert largest[0] > 0.9 > largest[1] > 0.5 > 0.35 > largest[2]


def test_goals_that_are_no_cuboid_have_no_multilinear_weights() -> None:
    with pytest.raises(UsageError, match="corners of a cuboid, these 3 are not"):
        drawn(1, SQUARE[:3], weights="multilinear")
    with pytest.raises(UsageError, match="needs two goals"):
        drawn(1, SQUARE[:1], weights="neighbours")
    assert drawn(5, SQUARE[:3], weights="dirichlet").shape == (5, 3)


def test_some_episodes_are_mixed_and_the_others_keep_their_skill() -> None:
    skill = np.arange(4000) % 4
    found, weights = Mixer.of(Mixtures(share=0.3), SQUARE, (0, 1, 2, 3)).mix(skill, 4, np.random.default_rng(0))
    mixed = found == MIXED
    assert mixed.mean() == pytest.approx(0.3, abs=0.03)
    np.testing.assert_array_equal(weights[~mixed], np.eye(4)[skill[~mixed]])
    assert (weights[mixed].max(axis=1) < 1).all()


def test_only_skills_that_can_be_mixed_are() -> None:
    skill, goals = np.arange(3000) % 3, np.array([[0.0, 0, 0], [5, 5, 5], [1, 0, 0]])
    found, weights = Mixer.of(Mixtures(share=0.5, weights="multilinear"), goals, (0, 2)).mix(skill, 3, np.random.default_rng(0))
    mixed = found == MIXED
    assert not mixed[skill == 1].any() and mixed[skill != 1].mean() == pytest.approx(0.5, abs=0.05)
    assert (weights[mixed][:, 1] == 0).all() and (weights[mixed][:, [0, 2]] > 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_without_a_share_nothing_is_drawn() -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    for mixer in (UNMIXED, Mixer.of(Mixtures(), SQUARE, (0, 1, 2, 3))):
        assert mixer.mix(np.arange(4), 4, rng)[0].tolist() == [0, 1, 2, 3]
    assert rng.bit_generator.state == before


def test_the_share_is_phased_in() -> None:
    mixtures = Mixtures(share=0.6, span=(0.3, 0.55))
    assert [mixtures.share_at(progress) for progress in (0.0, 0.3, 0.425, 0.55, 1.0)] == pytest.approx([0, 0, 0.3, 0.6, 0.6])
    assert Mixtures(share=0.6).share_at(0) == 0.6


def test_a_recipe_without_mixtures_does_not_mention_them() -> None:
    assert "mixtures" not in load_recipe("reach").model_dump(mode="json")
    assert load_recipe("reach", ["mixtures.share=0"]).fingerprint() == load_recipe("reach").fingerprint()


@pytest.mark.parametrize(
    "setting", ["mixtures.share=1", "mixtures.span=[0.5, 0.2]", "mixtures.weights=even", "mixtures.concentration=0"]
)
def test_settings_that_make_no_sense_are_refused(setting: str) -> None:
    with pytest.raises(UsageError, match="mixtures"):
        load_recipe("reach", [setting])


def rollout_of(trained: Learner, share: float = 0.5) -> Any:
    mixer = Mixer.of(Mixtures(share=share), SQUARE, (0, 1, 2, 3))
    return collect(trained.env, trained.agent, trained.pool, 0.0, np.random.default_rng(1), mixer)


def test_latent_and_goal_of_an_episode_are_the_same_mixture() -> None:
    trained = learner()
    rollout = rollout_of(trained)
    assert 0 < (rollout.skill == MIXED).sum() < 8
    mean, std = trained.agent.embed()
    weights = rollout.weights
    np.testing.assert_allclose(rollout.latent, weights @ mean + (weights @ std) * rollout.noise, rtol=1e-5)
    np.testing.assert_allclose(trained.env.desired_goal, weights @ SQUARE, atol=1e-6)
    alone = rollout.skill != MIXED
    np.testing.assert_array_equal(weights[alone], np.eye(4)[rollout.skill[alone]])


def test_the_ratio_is_taken_at_the_mixture_of_the_embedding_as_it_is_now() -> None:
    trained = learner()
    rollout = rollout_of(trained)
    batch, _ = te_ppo.prepare(rollout, trained.agent, MIXED_RECIPE.training)
    everything = torch.arange(len(batch.action))
    same = te_ppo.present_latent(batch, trained.agent, everything)
    np.testing.assert_allclose(same.detach(), batch.latent, rtol=1e-5)
    with torch.no_grad():
        trained.agent.embedding.raw_mean.zero_()  # all means at the origin: what is left is (sum of w std) epsilon
        trained.agent.embedding.raw_mean[0] = torch.atanh(torch.tensor([0.5, -0.5]))
        latent = te_ppo.present_latent(batch, trained.agent, everything)
        expected = batch.weights[:, :1] * torch.tensor([0.5, -0.5]) + batch.weights @ trained.agent.embedding.std * batch.noise
        np.testing.assert_allclose(latent, expected, rtol=1e-5, atol=1e-7)
        log_prob = te_ppo._log_prob(batch, trained.agent, everything)
        by_hand = gaussian.log_prob(batch.action, trained.agent.policy(batch.observation, expected), trained.agent.policy.std)
        np.testing.assert_allclose(log_prob, by_hand, rtol=1e-4)


def test_every_skill_of_a_mixture_learns_by_its_weight() -> None:
    trained = learner()
    batch, _ = te_ppo.prepare(rollout_of(trained), trained.agent, MIXED_RECIPE.training)
    one = torch.nonzero(batch.weights.amax(1) < 1)[:1, 0]
    te_ppo.present_latent(batch, trained.agent, one).sum().backward()  # type: ignore[no-untyped-call]
    gradient = trained.agent.embedding.raw_mean.grad
    assert gradient is not None
    expected = batch.weights[one].T * (1 - trained.agent.embedding.mean.detach() ** 2)  # through the tanh of the means
    np.testing.assert_allclose(gradient, expected, rtol=1e-5)


@pytest.mark.slow
def test_the_value_function_sees_the_weights() -> None:
    trained = learner()
    batch, _ = te_ppo.prepare(rollout_of(trained), trained.agent, MIXED_RECIPE.training)
    mixed = batch.weights.amax(1) < 1
    np.testing.assert_allclose(batch.weights.sum(dim=1), 1, rtol=1e-6)
    assert (batch.weights[mixed] > 0).sum(dim=1).min() > 1
    trained.iterate()


@pytest.mark.slow
def test_training_with_mixtures_goes_on_from_a_saved_state_bit_for_bit() -> None:
    whole, half = learner(), learner()
    for _ in range(6):
        whole.iterate()
    for _ in range(3):
        half.iterate()
    arrays, state = half.state()
    arrays = {path: array.copy() for path, array in arrays.items()}
    resumed = learner()
    resumed.iterate()
    resumed.load(arrays, state)
    for _ in range(3):
        resumed.iterate()
    weights = whole.agent.arrays()
    assert all(np.array_equal(array, weights[name]) for name, array in resumed.agent.arrays().items())
    assert whole.curves.keys() == resumed.curves.keys() == curve_names(4, ["distance"], mixed=True)
    for name, curve in whole.curves.items():
        np.testing.assert_array_equal(curve, resumed.curves[name])


@pytest.mark.slow
def test_curves_of_mixtures_have_gaps_where_there_are_none_and_skills_count_their_own_episodes() -> None:
    trained = learner(load_recipe("point", [*TINY, "mixtures.share=0.9", "mixtures.span=[0.5, 0.5]", "task.tolerance=100"]))
    for _ in range(6):
        trained.iterate()
    for name in OF_MIXTURES:
        assert np.isnan(trained.curves[name]).tolist() == [True] * 3 + [False] * 3
    assert trained.curves["mixed/success_rate"][3:] == [1] * 3
    assert trained.curves["success/1"][:3] == [1] * 3
    assert not set(OF_MIXTURES) & curve_names(4, ["distance"])


@pytest.mark.slow
def test_mixtures_that_have_not_begun_change_nothing() -> None:
    plain, later = (
        learner(load_recipe("point", TINY)),
        learner(load_recipe("point", [*TINY, "mixtures.share=0.5", "mixtures.span=[0.9, 1]"])),
    )
    for _ in range(5):
        plain.iterate()
        later.iterate()
    weights = plain.agent.arrays()
    assert all(np.array_equal(array, weights[name]) for name, array in later.agent.arrays().items())
