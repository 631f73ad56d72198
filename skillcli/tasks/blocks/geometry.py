"""Directions of blocks and hands, for observations and rewards."""

from __future__ import annotations

import numpy as np

from skillcli.simulation.rotations import frames
from skillcli.trajectories import Array

QUARTERS = 4  # quarter turns after which a cube, seen from above, looks as before


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


def hand_frames(closing: Array, pointing: Array) -> Array:
    """Return the orientation of blocks between fingers, as rotation matrices (n, 3, 3); in a hand that points down upright.

    Args:
        closing: directions in which fingers close, unit vectors (n, 3).
        pointing: directions in which hands point, unit vectors (n, 3) at right angles to them.
    """
    upward = -pointing
    return np.stack([closing, np.cross(upward, closing), upward], axis=2)


def quarter_turn(angle: Array) -> Array:
    """Return the smallest rotation that differs from angles (n,) by quarter turns, (n,) rad within ±45 degrees."""
    quarter = 2 * np.pi / QUARTERS
    smallest: Array = angle - quarter * np.round(angle / quarter)
    return smallest
