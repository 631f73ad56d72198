"""The formulas of TE-PPO against numbers worked out by hand."""

import math

import numpy as np
import pytest
import torch

from skillcli.learning import gaussian
from skillcli.learning.ppo_update import adapted_learning_rate, approximate_kl, surrogate_loss
from skillcli.learning.settings import Training
from skillcli.learning.te_ppo import annealed_kl, annealed_std, augmented_reward

# ratio, advantage, what the objective counts with a clip of 0.2, whether it still pulls
SURROGATE = [
    (1.0, 2.0, 2.0, True),
    (1.5, 1.0, 1.2, False),  # good, and made likelier than allowed
    (0.5, 1.0, 0.5, True),  # good, and made unlikelier: pull it back
    (1.5, -1.0, -1.5, True),  # bad, and made likelier: push it back
    (0.5, -1.0, -0.8, False),  # bad, and made unlikelier than allowed
]


@pytest.mark.parametrize(("ratio", "advantage", "counted", "pulls"), SURROGATE)
def test_the_surrogate_is_clipped_only_where_it_would_gain(ratio: float, advantage: float, counted: float, pulls: bool) -> None:
    old = torch.tensor([-1.0])
    new = (old + math.log(ratio)).requires_grad_()
    loss = surrogate_loss(new, old, torch.tensor([advantage]), 0.2)
    assert float(loss.detach()) == pytest.approx(-counted)
    loss.backward()  # type: ignore[no-untyped-call]
    assert new.grad is not None and bool(new.grad != 0) == pulls


def test_the_surrogate_is_a_mean_over_samples() -> None:
    ratio, advantage = (torch.tensor([row[i] for row in SURROGATE]) for i in (0, 1))
    loss = surrogate_loss(ratio.log(), torch.zeros(5), advantage, 0.2)
    assert float(loss) == pytest.approx(-(2.0 + 1.2 + 0.5 - 1.5 - 0.8) / 5)


def test_approximate_kl_by_hand_and_never_negative() -> None:
    # ratios 2 and 1: ((2 - 1 - log 2) + 0) / 2
    assert float(approximate_kl(torch.tensor([math.log(2), 0.0]), torch.zeros(2))) == pytest.approx((1 - math.log(2)) / 2)
    assert float(approximate_kl(torch.tensor([-0.3]), torch.zeros(1))) > 0


def test_approximate_kl_estimates_the_divergence_of_two_gaussians() -> None:
    x = torch.randn(200_000, 1, generator=torch.Generator().manual_seed(0))
    old = gaussian.log_prob(x, torch.zeros(1), torch.ones(1))
    new = gaussian.log_prob(x, torch.full((1,), 0.2), torch.ones(1))
    assert float(approximate_kl(new, old)) == pytest.approx(0.2**2 / 2, rel=0.02)


def test_the_reward_is_scaled_and_diversity_is_clipped_on_both_sides() -> None:
    training = Training(reward_scale=5, inference_reward=0.02, inference_clip=6)
    found = augmented_reward(np.full((1, 3), -1.0), np.array([[3.0, 10.0, -10.0]]), training)
    assert found.tolist() == [pytest.approx([-5 + 0.06, -5 + 0.12, -5 - 0.12])]


@pytest.mark.parametrize(
    ("rate", "kl", "expected"),
    [
        (1e-3, 0.021, 1e-3 / 1.5),
        (1e-3, 0.004, 1.5e-3),
        (1e-3, 0.01, 1e-3),
        (1e-3, 0.019, 1e-3),
        (1e-5, 1.0, 1e-5),
        (1e-2, 0.0, 1e-2),
    ],
)
def test_the_step_size_follows_the_kl_divergence_within_bounds(rate: float, kl: float, expected: float) -> None:
    assert adapted_learning_rate(rate, kl, target=0.01) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("settle_from", "progress", "expected"),
    [(0.0, 0.0, 0.01), (0.0, 0.5, 0.005), (0.0, 1.0, 0.0005), (0.6, 0.6, 0.01), (0.6, 0.8, 0.005), (0.6, 1.0, 0.0005)],
)
def test_the_target_kl_shrinks_towards_the_end(settle_from: float, progress: float, expected: float) -> None:
    assert annealed_kl(0.01, settle_from, progress) == pytest.approx(expected)


def test_exploration_comes_down_by_the_same_factor_each_time() -> None:
    assert [annealed_std(0.01, 0.5, progress) for progress in (0.0, 0.5, 0.75, 1.0)] == pytest.approx([1, 1, 0.1, 0.01])
    assert annealed_std(1.0, 0.5, 1.0) == 1


def test_the_target_kl_need_not_shrink_at_all() -> None:
    assert [annealed_kl(0.01, 1.0, progress) for progress in (0.0, 0.5, 0.999)] == [0.01] * 3
