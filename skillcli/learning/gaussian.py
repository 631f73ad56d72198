"""Diagonal Gaussians as free functions over the last axis."""

from __future__ import annotations

import math

import torch
from torch import Tensor

_LOG_2PI = math.log(2.0 * math.pi)


def log_prob(x: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Compute the log density, nat: (..., d) and broadcast parameters to (...,)."""
    standard = (x - mean) / std
    return (-0.5 * (standard.square() + _LOG_2PI) - std.log()).sum(-1)


def entropy(std: Tensor) -> Tensor:
    """Compute the differential entropy, nat: (..., d) to (...,)."""
    return (0.5 * (1.0 + _LOG_2PI) + std.log()).sum(-1)


def bounded_std(raw: Tensor, low: float, high: float) -> Tensor:
    """Map unbounded parameters smoothly into (low, high)."""
    return low + (high - low) * torch.sigmoid(raw)


def inverse_bounded_std(std: float, low: float, high: float) -> float:
    """Return the raw parameter that `bounded_std` maps to std; low < std < high."""
    share = (std - low) / (high - low)
    return math.log(share / (1.0 - share))
