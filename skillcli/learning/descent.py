"""Gradient steps, the minibatches that they are taken on, and pieces of what is computed without gradients."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import torch
from torch import Tensor

from skillcli.trajectories import Array


def minibatches(order: Array, size: int) -> Iterator[Tensor]:
    """Split a permutation (n,) into pieces of about this size, at least one."""
    for piece in np.array_split(order, max(1, round(len(order) / size))):
        yield torch.from_numpy(piece)


def rows(samples: Tensor, chosen: Tensor) -> Tensor:
    """Return samples (n, ...) with indices (m,), (m, ...); `samples[chosen]` says the same and takes five times as long."""
    return samples.index_select(0, chosen)


PIECE = 2048  # samples


def in_pieces(function: Callable[..., Tensor], *samples: Tensor) -> Tensor:
    """Compute a function of samples (T, N, ...) in pieces of T: larger arrays leave the cache, and take twice as long."""
    steps = max(1, PIECE // samples[0].shape[1])
    pieces = zip(*(torch.split(each, steps) for each in samples), strict=True)
    return torch.cat([function(*piece) for piece in pieces])


def descend(optimizer: torch.optim.Optimizer, loss: Tensor, max_norm: float = math.inf) -> None:
    """Take one gradient step, with the gradient's norm clipped."""
    optimizer.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    if math.isfinite(max_norm):
        torch.nn.utils.clip_grad_norm_(optimizer.param_groups[0]["params"], max_norm)
    optimizer.step()
