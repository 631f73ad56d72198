from __future__ import annotations

import numpy as np
import pytest
import torch

from skillcli.learning.agent import Actor, Agent, windows
from skillcli.learning.networks import CLIP, Normalizer, affine, arranged, set_apart, spread, tanh
from skillcli.recipe import Recipe, load_recipe, resolve

REACH = load_recipe("reach")
GOALS = np.array(REACH.task.goals)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


LINEAR = resolve(REACH.model_dump(mode="json"), ["network.linear_latent=true"])


def agent(seed: int = 0, recipe: Recipe = REACH) -> Agent:
    made = Agent(recipe, 10, 7, GOALS, seed)
    made.normalizer.update(2 + 3 * torch.randn(100, 10, generator=chance()))
    for weight in made.policy.parameters():  # off its small start, so that differences show
        weight.data += 0.1 * torch.randn(weight.shape, generator=chance(1))
    return made


def test_the_normalizer_holds_mean_and_variance_of_all_it_has_seen() -> None:
    rng = np.random.default_rng(0)
    batches = [rng.normal(loc, scale, (n, 3)).astype(np.float32) for loc, scale, n in ((0, 1, 5), (10, 2, 50), (-3, 0.1, 7))]
    normalizer = Normalizer(3)
    for batch in batches:
        normalizer.update(torch.from_numpy(batch))
    together = np.concatenate(batches)
    np.testing.assert_allclose(normalizer.mean, together.mean(0), rtol=1e-5)
    np.testing.assert_allclose(normalizer.variance, together.var(0), rtol=1e-4)
    assert float(normalizer.count) == 62
    normal = (together - together.mean(0)) / np.sqrt(together.var(0) + 1e-6)
    np.testing.assert_allclose(normalizer(torch.from_numpy(together)), normal, atol=1e-3)
    assert normalizer(torch.full((1, 3), 1e6)).tolist() == [[CLIP] * 3]


def test_the_fast_tanh_is_tanh_with_its_derivative() -> None:
    x = torch.cat([torch.linspace(-12, 12, 2001), torch.tensor([-1e30, -100.0, -1e-6, 0.0, 1e-6, 100.0, 1e30])])
    x.requires_grad_()
    y = tanh(x)
    y.backward(torch.full_like(x, 3.0))  # type: ignore[no-untyped-call]
    exact = torch.tanh(x.detach().double())
    np.testing.assert_allclose(y.detach(), exact, atol=2e-7)
    assert x.grad is not None
    np.testing.assert_allclose(x.grad, 3 * (1 - exact**2), atol=2e-6)


def test_windows_repeat_the_first_observation_where_there_are_fewer() -> None:
    observation = torch.tensor([[[1.0, 10]], [[2.0, 20]], [[3.0, 30]]])  # (T, N, o) = (3, 1, 2)
    assert windows(observation, 2)[:, 0].tolist() == [[1, 10, 1, 10], [1, 10, 2, 20], [2, 20, 3, 30]]
    assert windows(observation, 4)[2, 0].tolist() == [1, 10, 1, 10, 2, 20, 3, 30]


@pytest.mark.parametrize("recipe", [REACH, LINEAR], ids=["latent as input", "linear in the latent"])
def test_the_fast_actor_does_what_the_agent_does(recipe: Recipe) -> None:
    made, rng = agent(recipe=recipe), np.random.default_rng(0)
    latent = rng.normal(size=(5, 3)).astype(np.float32)
    act = Actor(made, latent)
    for scale in (1, 3, 100):  # the last one clipped by the normaliser
        observation = (scale * rng.normal(size=(5, 10))).astype(np.float32)
        before = observation.copy()
        np.testing.assert_allclose(act(observation), made.act(observation, latent), rtol=1e-5, atol=1e-6)
        np.testing.assert_array_equal(observation, before)


def test_an_affine_function_by_hand() -> None:
    parts, latent = torch.tensor([[1.0, 2, 10, 20, 100, 200]]), torch.tensor([[0.5, -1]])  # f, then G column by column
    assert affine(parts, latent).tolist() == [[1 + 5 - 100, 2 + 10 - 200]]


def test_between_two_latents_a_linear_policy_acts_between_the_two() -> None:
    observation = np.random.default_rng(0).normal(size=(5, 10))
    latents = np.array([[0.5, -0.2, 0.1], [-0.5, 0.6, 0.3], [0.0, 0.2, 0.2]])
    for recipe, between in ((LINEAR, True), (REACH, False)):
        made = agent(recipe=recipe)
        first, second, middle = (made.act(observation, np.tile(latent, (5, 1))) for latent in latents)
        assert np.abs(first - second).max() > 0.01
        assert (np.abs(middle - (first + second) / 2).max() < 1e-5) == between


def test_an_actor_keeps_the_weights_it_was_made_with() -> None:
    made, observation, latent = agent(), np.ones((2, 10), dtype=np.float32), np.ones((2, 3), dtype=np.float32)
    act = Actor(made, latent)
    before = act(observation)
    made.normalizer.update(torch.full((50, 10), 7.0))
    made.policy.body[-1].bias.data += 1.0
    np.testing.assert_array_equal(act(observation), before)


def test_the_policy_sees_observation_and_latent_and_nothing_else() -> None:
    made = agent()
    assert made.policy.body[0].in_features == 10 + 3
    assert made.value.body[0].in_features == 10 + 3 + 8, "the value function may know the skill"
    informed = Agent(REACH, 10, 7, GOALS, privileged=4)
    assert informed.value.body[0].in_features == 10 + 4 + 3 + 8, "and what only a simulation knows"
    assert informed.policy.body[0].in_features == 10 + 3 and informed.inference.body[0].in_features == 6 * 10
    assert made.inference.body[0].in_features == 6 * 10
    same = np.ones((2, 10), dtype=np.float32)
    near, far = made.act(same, np.array([[0.5, 0, 0], [0.5, 0, 0]])), made.act(same, np.array([[0.5, 0, 0], [-0.5, 0, 0]]))
    np.testing.assert_allclose(near[0], near[1], atol=1e-6, err_msg="up to rounding, which follows the row on some machines")
    assert np.abs(far[0] - far[1]).max() > 0.01


def test_an_agent_is_the_same_after_it_was_stored() -> None:
    made, other = agent(), Agent(REACH, 10, 7, GOALS, seed=5)
    stored = made.arrays()
    other.load(stored)
    observation, latent = np.ones((2, 10), dtype=np.float32), np.zeros((2, 3))
    np.testing.assert_array_equal(other.act(observation, latent), made.act(observation, latent))
    np.testing.assert_array_equal(other.infer(np.ones((2, 6, 10))), made.infer(np.ones((2, 6, 10))))
    made.policy.log_std.data += 1
    assert (stored["policy.log_std"] == other.policy.log_std.detach().numpy()).all(), "what was stored is a copy"


def test_what_only_the_value_function_sees_is_normalised_and_stored_beside_the_rest() -> None:
    made, other = Agent(REACH, 10, 7, GOALS, privileged=2), Agent(REACH, 10, 7, GOALS, seed=5, privileged=2)
    made.update_normalizers(torch.zeros(2, 10), torch.tensor([[1.0, 10], [3.0, 10]]))
    normal = made.normalized_privileged(torch.tensor([[2.0, 10], [4.0, 10]]))  # mean 2 and 10, deviation 1 and 0
    np.testing.assert_allclose(normal, [[0, 0], [2, 0]], atol=1e-4)
    other.load(made.arrays())
    inputs = torch.ones(3, 10), normal[:1].expand(3, 2), torch.zeros(3, 3), torch.zeros(3, 8)
    np.testing.assert_array_equal(other.value(*inputs).detach(), made.value(*inputs).detach())
    np.testing.assert_array_equal(other.normalized_privileged(torch.ones(1, 2)), made.normalized_privileged(torch.ones(1, 2)))


def test_without_anything_privileged_the_agent_holds_no_trace_of_it() -> None:
    made = agent()
    assert not any("privileged" in name for name in made.arrays())
    assert made.normalized_privileged(torch.zeros(5, 0)).shape == (5, 0)


def test_weights_follow_the_seed() -> None:
    first, again, other = (Agent(REACH, 10, 7, GOALS, seed).arrays() for seed in (0, 0, 1))
    assert all((first[name] == again[name]).all() for name in first)
    assert any((first[name] != other[name]).any() for name in first)


def test_the_embedding_starts_where_it_is_told() -> None:
    mean, std = Agent(REACH, 10, 7, GOALS).embed()
    expected = arranged(torch.as_tensor(GOALS, dtype=torch.float32), 3, chance())
    np.testing.assert_allclose(mean, expected, atol=1e-6)
    np.testing.assert_allclose(std, REACH.embedding.initial_std, rtol=1e-5)


def test_arranged_latents_keep_the_neighbourhood_of_the_goals() -> None:
    goals = torch.as_tensor(GOALS, dtype=torch.float32)
    latent = arranged(goals, 3, chance())
    assert latent.abs().max() == pytest.approx(0.8)
    assert float(torch.pdist(latent).min()) > 0.2
    far = torch.cdist(goals, goals).argmax(1)
    assert (torch.cdist(latent, latent).argmax(1) == far).all(), "opposite corners stay opposite"
    moved = arranged(goals + torch.tensor([3.0, 1, 2]), 3, chance())
    np.testing.assert_allclose(torch.pdist(moved), torch.pdist(latent), atol=1e-4)


@pytest.mark.parametrize(
    "goals",
    [
        torch.zeros(4, 3),  # all the same
        torch.tensor([[0.0, 0, 0], [1e-3, 0, 0], [5, 0, 0]]),  # two nearly the same
    ],
)
def test_goals_that_do_not_tell_skills_apart_give_a_random_spread(goals: torch.Tensor) -> None:
    found = arranged(goals, 2, chance())
    assert float(torch.pdist(found).min()) > 0.2
    np.testing.assert_array_equal(found, spread(len(goals), 2, chance()))


def test_one_goal_and_more_dimensions_than_goals_have_are_fine() -> None:
    assert arranged(torch.tensor([[0.5, 0, 0]]), 3, chance()).isfinite().all()
    flat = arranged(torch.tensor([[0.0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]]), 5, chance())
    assert flat.shape == (4, 5) and (flat[:, 2:] == 0).all()


def test_spread_points_lie_in_the_cube_apart_from_each_other() -> None:
    for seed in range(5):
        points = spread(8, 3, chance(seed))
        assert points.abs().max() <= 0.8 and float(torch.pdist(points).min()) > 0.5


def test_an_isometric_arrangement_keeps_the_proportions_of_all_distances() -> None:
    goals = torch.tensor([[x, y, z] for x in (0.5, 0.7) for y in (-0.3, 0.3) for z in (0.15, 0.3)])
    means = arranged(goals, 3, torch.Generator().manual_seed(0), isometric=True)
    ratio = torch.pdist(means) / torch.pdist(goals)
    torch.testing.assert_close(ratio, torch.full_like(ratio, 0.8 / 0.3))  # the longest half axis becomes 0.8


def test_skills_that_cannot_be_mixed_lie_off_the_others_on_axes_of_their_own() -> None:
    # corners of a segment of 2 m, and two skills in its middle: each 1 m off it, at right angles
    goals = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 1]])
    np.testing.assert_array_equal(
        set_apart(goals, (0, 2)), [[0, 0, 0, 0, 0], [1, 0, 0, 1, 0], [2, 0, 0, 0, 0], [1, 0, 0, 0, 1]]
    )
    assert set_apart(goals, (0, 1, 2, 3)) is goals
