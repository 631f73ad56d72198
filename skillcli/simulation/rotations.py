"""Orientations of objects: quaternions w x y z, and what follows from them."""

from __future__ import annotations

import numpy as np

from skillcli.trajectories import Array


def upright(yaw: Array) -> Array:
    """Return rotations by angles (n,) rad about the vertical as quaternions, (n, 4) w x y z."""
    zero = np.zeros(len(yaw))
    return np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=1)


def up(turned: Array) -> Array:
    """Return the upward direction in the frames of objects with orientations (n, 4) w x y z, unit vectors (n, 3)."""
    w, x, y, z = turned.T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)


def frames(turned: Array) -> Array:
    """Convert quaternions (n, 4) w x y z to rotation matrices (n, 3, 3); their columns are an object's axes."""
    w, x, y, z = turned.T
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def quaternions(matrices: Array) -> Array:
    """Convert rotation matrices (n, 3, 3) to quaternions (n, 4) w x y z, the inverse of `frames`."""
    from scipy.spatial.transform import Rotation  # slow to import, and only needed here

    found: Array = Rotation.from_matrix(matrices).as_quat(scalar_first=True) if len(matrices) else np.zeros((0, 4))
    return found
