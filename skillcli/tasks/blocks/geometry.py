"""Directions of blocks and hands, for observations and rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

QUARTERS = 4  # quarter turns after which a cube, seen from above, looks as before


def frames(turned: Array) -> Array:
    """Convert quaternions (n, 4) w x y z to rotation matrices (n, 3, 3); their columns are the axes of the body."""
    w, x, y, z = turned.T
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def upright(yaw: Array) -> Array:
    """Return rotations by angles (n,) rad about the vertical as quaternions, (n, 4) w x y z."""
    zero = np.zeros(len(yaw))
    return np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=1)


def heading(axis: Array) -> Array:
    """Return the direction of axes (n, 3) as seen from above, (n,) rad."""
    angle: Array = np.arctan2(axis[:, 1], axis[:, 0])
    return angle


def face_heading(turned: Array) -> Array:
    """Return the direction of a side face of cubes (n, 4) w x y z as seen from above, (n,) rad, known up to quarter turns.

    It is the heading of the axis that is the most level, so that a toppled cube has one too.
    """
    axes = frames(turned)
    most_level = np.abs(axes[:, 2]).argmin(axis=1)
    return heading(axes[np.arange(len(axes)), :, most_level])


def quarter_turn(angle: Array) -> Array:
    """Return the smallest rotation that differs from angles (n,) by quarter turns, (n,) rad within ±45 degrees."""
    quarter = 2 * np.pi / QUARTERS
    smallest: Array = angle - quarter * np.round(angle / quarter)
    return smallest
