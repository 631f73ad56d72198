"""Learned composers on a problem that is solved by hand: the best latent is the one that points from here to the goal."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from skillcli.composition.latent_bounds import LatentBounds
from skillcli.errors import SkillError
from skillcli.learning.composer import check_finite
from skillcli.learning.ddpg_composer import DdpgComposer
from skillcli.learning.ddpg_method import DdpgSettings
from skillcli.learning.ppo_composer import PpoComposer
from skillcli.learning.ppo_method import PpoSettings
from skillcli.trajectories import Array

pytestmark = pytest.mark.slow

BOX = np.array([[-1.0, 0.0], [3.0, 2.0]])
GOAL = np.array([2.2, 0.6])
DDPG = DdpgSettings(
    iterations=20, gradient_steps=40, simulations=16, hidden=(64, 64), learning_rate=3e-3, minibatch=64, discount=0.5,
    target_rate=0.05,
)  # fmt: skip
PPO = PpoSettings(iterations=30, simulations=64, hidden=(32,), epochs=10, learning_rate=5e-3)
CHOICES = np.array([[-1.0, 0], [3, 0], [2, 1], [3, 2]])


def ddpg(choices: Array | None = None, seed: int = 0, **changes: object) -> DdpgComposer:
    return DdpgComposer(2, BOX, choices, DDPG.model_copy(update=changes), seed)


def teach(composer: DdpgComposer | PpoComposer, rounds: int, num_envs: int, steps: int = 2) -> Array:
    """Episodes in which every step gives minus the distance of the latent to the goal; the greedy latents (T, d)."""
    chosen = np.zeros((steps, 2))
    for _ in range(rounds):
        features = np.zeros((num_envs, 2))
        for t in range(steps):
            latent = composer.act(features)
            chosen[t], features = latent[0], np.full((num_envs, 2), (t + 1) / steps)
            composer.observe(-np.linalg.norm(latent - GOAL, axis=1), features, np.zeros(num_envs, dtype=bool))
        composer.update(np.ones((steps, num_envs), dtype=bool))
    return chosen


def test_ddpg_finds_the_latent_that_is_worth_most() -> None:
    assert np.linalg.norm(teach(ddpg(), 20, 16) - GOAL, axis=1).max() < 0.4, "of a box of 4 by 2"


@pytest.mark.parametrize("candidates", [1, 3])
def test_a_discrete_ddpg_only_ever_chooses_what_it_may_and_finds_the_best(candidates: int) -> None:
    composer = ddpg(CHOICES, candidates=candidates)
    tried = np.concatenate([composer.act(np.zeros((16, 2))) for _ in range(3)])
    assert {tuple(np.round(latent, 4)) for latent in tried} <= {tuple(choice) for choice in CHOICES}
    np.testing.assert_allclose(teach(ddpg(CHOICES, candidates=candidates), 20, 16), [[2, 1], [2, 1]], atol=1e-5)


def test_ppo_finds_the_latent_that_is_worth_most() -> None:
    assert np.linalg.norm(teach(PpoComposer(2, BOX, PPO, 0), 30, 64) - GOAL, axis=1).max() < 0.2


@pytest.mark.parametrize("make", [lambda seed: ddpg(seed=seed), lambda seed: PpoComposer(2, BOX, PPO, seed)])
def test_the_seed_decides_everything(make: object) -> None:
    first, again, other = (teach(make(seed), 6, 8) for seed in (3, 3, 4))  # type: ignore[operator]
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_latents_stay_in_their_box_and_episode_zero_does_not_explore() -> None:
    for composer in (ddpg(noise=50.0, warm_up=1), PpoComposer(2, BOX, PPO.model_copy(update={"initial_std": 1.0}), 0)):
        teach(composer, 2, 8)
        chosen = composer.act(np.zeros((200, 2)))
        assert (chosen >= BOX[0] - 1e-6).all() and (chosen <= BOX[1] + 1e-6).all()
        assert len(np.unique(chosen[1:], axis=0)) > 4
        np.testing.assert_allclose(composer.act(np.zeros((200, 2)))[0], chosen[0])


def test_units_and_latents_are_the_same_thing() -> None:
    box = LatentBounds(BOX)
    assert box.latent(np.array([[-1.0, 0], [1, 7]])).tolist() == [[-1, 1], [3, 2]], "what leaves the box is clipped"
    np.testing.assert_allclose(box.unit(box.latent(np.array([[0.3, -0.7]]))), [[0.3, -0.7]])


def test_what_came_after_a_failure_is_not_learned_from() -> None:
    composer = ddpg(warm_up=1, gradient_steps=1)
    for _ in range(2):
        composer.act(np.zeros((3, 2)))
        composer.observe(np.zeros(3), np.zeros((3, 2)), np.zeros(3, dtype=bool))
    composer.update(np.array([[True, True, True], [True, True, False]]))
    assert composer.replay.filled == 5


@pytest.mark.parametrize("make", [lambda: ddpg(warm_up=1), lambda: PpoComposer(2, BOX, PPO, 0)])
def test_a_composer_that_comes_apart_says_so(make: object) -> None:
    composer = make()  # type: ignore[operator]
    with pytest.raises(SkillError, match="diverged") as caught:
        for _ in range(3):
            composer.act(np.zeros((8, 2)))
            composer.observe(np.full(8, np.nan), np.zeros((8, 2)), np.zeros(8, dtype=bool))
            composer.update(np.ones((1, 8), dtype=bool))
    assert "learning_rate" in caught.value.hint


def test_what_is_finite_passes() -> None:
    check_finite("ddpg", {"q": 1.0}, torch.nn.Linear(2, 2))
    with pytest.raises(SkillError, match="ddpg composer diverged: q, weights"):
        broken = torch.nn.Linear(1, 1)
        torch.nn.init.constant_(broken.weight, math.inf)
        check_finite("ddpg", {"q": math.nan}, broken)
