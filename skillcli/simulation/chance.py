"""Random numbers for simulations that run in one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from skillcli.trajectories import Array

Rng = np.random.Generator | Sequence[np.random.Generator]
USES = ("drift", "noise", "angle", "latency", "forces")


class Chance:
    """Random numbers of N simulations, from one generator or from one each.

    With one each, an episode depends neither on the number of episodes in the batch nor on their parameters: every use of
    random numbers has its own stream.

    Args:
        rng: one generator, which is fast, or N.
    """

    def __init__(self, rng: Rng) -> None:
        self._all = rng if isinstance(rng, np.random.Generator) else None
        own = [] if isinstance(rng, np.random.Generator) else [one.spawn(len(USES)) for one in rng]
        self._own = {use: [streams[index] for streams in own] for index, use in enumerate(USES)}

    def normal(self, use: str, shape: tuple[int, ...], of: Array, axis: int = 0) -> Array:
        """Draw standard normal numbers of this shape; along `axis` are the simulations `of` (n,)."""
        return self._draw(use, shape, of, axis, lambda rng, part: rng.standard_normal(part))

    def uniform(self, use: str, shape: tuple[int, ...], of: Array, axis: int = 0) -> Array:
        """Draw like `normal`, but uniformly from [0, 1)."""
        return self._draw(use, shape, of, axis, lambda rng, part: rng.random(part))

    def integers(self, use: str, high: Array) -> Array:
        """Draw an integer from 0 up to below `high` (N,) for each simulation, (N,)."""
        if self._all is not None:
            drawn: Array = self._all.integers(high)
            return drawn
        return np.array([rng.integers(bound) for rng, bound in zip(self._own[use], high, strict=True)])

    def _draw(
        self,
        use: str,
        shape: tuple[int, ...],
        of: Array,
        axis: int,
        draw: Callable[[np.random.Generator, tuple[int, ...]], Array],
    ) -> Array:
        if self._all is not None:
            return draw(self._all, shape)
        part, own = (*shape[:axis], *shape[axis + 1 :]), self._own[use]
        return np.stack([draw(own[simulation], part) for simulation in of], axis=axis) if len(of) else np.zeros(shape)
