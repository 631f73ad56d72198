"""Where a viewer looks from first; recordings and `skill play` share it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skillcli.trajectories import Array


class Viewpoint(NamedTuple):
    """A camera, in the frame of what it looks at."""

    position: Array  # (3,) m
    target: Array  # (3,) m
    up: tuple[float, float, float]


def viewpoint(points: Array, flat: bool, back: float = 1.0) -> Viewpoint:
    """Look at points (n, 3) m: from above if they lie in a plane, else from the front and the right of the robot.

    Args:
        points: all of them are to be seen.
        flat: whether they lie in a plane.
        back: factor of the distance.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    center, reach = (low + high) / 2, back * float(np.linalg.norm(high - low)) or 1.0
    away = np.array([0.0, 0.0, 0.85]) if flat else np.array([0.66, -0.58, 0.44])
    return Viewpoint(center + reach * away, center, (0.0, 1.0, 0.0) if flat else (0.0, 0.0, 1.0))
