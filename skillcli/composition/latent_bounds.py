"""The box of latents that composers choose from."""

from __future__ import annotations

import numpy as np

from skillcli.trajectories import Array


def bounds_of(mean: Array, std: Array) -> Array:
    """Return lowest and highest latent, (2, d): two standard deviations around all means, (K, d) each."""
    return np.stack([(mean - 2 * std).min(axis=0), (mean + 2 * std).max(axis=0)])


class LatentBounds:
    """Converts latents between bounds (2, d), lowest and highest, to units in [-1, 1]^d, and back."""

    def __init__(self, bounds: Array) -> None:
        self._centre, self._half = bounds.mean(axis=0), (bounds[1] - bounds[0]) / 2

    def latent(self, unit: Array) -> Array:
        """Convert units (N, d) to latents."""
        latent: Array = self._centre + self._half * np.clip(unit, -1.0, 1.0)
        return latent

    def unit(self, latent: Array) -> Array:
        """Convert latents (N, d) to units."""
        unit: Array = (latent - self._centre) / self._half
        return unit
