"""Gaussians against numbers worked out by hand."""

import math

import pytest
import torch

from skillcli.learning import gaussian

LOG_2PI = 1.8378770664


def test_log_density_of_a_gaussian() -> None:
    # one sigma off in both dimensions: -1/2 * (1 + 1) - log(2 pi) - log(1 * 2)
    x, mean, std = torch.tensor([[1.0, 3.0]]), torch.tensor([0.0, 1.0]), torch.tensor([1.0, 2.0])
    assert gaussian.log_prob(x, mean, std).tolist() == pytest.approx([-1 - LOG_2PI - math.log(2)])


def test_entropy_of_a_gaussian() -> None:
    # per dimension 1/2 * (1 + log(2 pi)) + log std
    assert float(gaussian.entropy(torch.tensor([1.0, 2.0]))) == pytest.approx(1 + LOG_2PI + math.log(2))


def test_a_bounded_std_keeps_its_bounds_and_has_an_inverse() -> None:
    assert gaussian.bounded_std(torch.tensor([-30.0, 0.0, 30.0]), 0.05, 0.45).tolist() == pytest.approx([0.05, 0.25, 0.45])
    raw = gaussian.inverse_bounded_std(0.3, 0.05, 0.5)
    assert float(gaussian.bounded_std(torch.tensor(raw), 0.05, 0.5)) == pytest.approx(0.3)
