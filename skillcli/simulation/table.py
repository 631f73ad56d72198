"""The table top as a plane that a domain may raise and tilt."""

from __future__ import annotations

import numpy as np

from skillcli.robots.scene import TABLE_CENTRE, TABLE_TOP
from skillcli.trajectories import Array


def normal(tilt: Array) -> Array:
    """Return unit normals (N, 3) of tops turned by rotation vectors (N, 2) rad about x and y."""
    angle = np.linalg.norm(tilt, axis=1)
    sine = np.sinc(angle / np.pi)  # sine of the angle, divided by the angle
    return np.stack([sine * tilt[:, 1], -sine * tilt[:, 0], np.cos(angle)], axis=1)


def quaternion(tilt: Array) -> Array:
    """Return the same rotations as quaternions, (N, 4) w x y z."""
    half = np.linalg.norm(tilt, axis=1) / 2
    sine = np.sinc(half / np.pi) / 2
    return np.stack([np.cos(half), sine * tilt[:, 0], sine * tilt[:, 1], np.zeros(len(tilt))], axis=1)


def turned(by: Array, orientation: Array) -> Array:
    """Turn orientations (N, 4) by rotations (N, 4) in the base frame, all as quaternions w x y z, (N, 4)."""
    (a, b, c, d), (w, x, y, z) = by.T, orientation.T
    product = (
        a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
    )  # fmt: skip
    return np.stack(product, axis=1)


def surface(xy: Array, height: Array, tilt: Array) -> Array:
    """Return the height of the top at places (N, 2) m, (N,) m, if its middle is raised by height (N,) m."""
    n = normal(tilt)
    level: Array = TABLE_TOP + height - np.einsum("ij,ij->i", n[:, :2], xy - np.array(TABLE_CENTRE)) / n[:, 2]
    return level
