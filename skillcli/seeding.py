"""One seed, many independent random generators.

Each use has a name and its own generator, so that drawing more for one never changes another.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch


def generator(seed: int, use: str) -> np.random.Generator:
    """Make the numpy generator of a seed for one named use, such as "rollout"."""
    return np.random.Generator(np.random.PCG64(_sequence(seed, use)))


def torch_generator(seed: int, use: str) -> torch.Generator:
    """Make the torch generator of a seed for one named use, such as "networks"."""
    import torch  # slow to import, and only training needs it

    state = int(_sequence(seed, use).generate_state(1, np.uint64)[0] >> np.uint64(1))
    return torch.Generator().manual_seed(state)


def _sequence(seed: int, use: str) -> np.random.SeedSequence:
    return np.random.SeedSequence(entropy=seed, spawn_key=(zlib.crc32(use.encode()),))
