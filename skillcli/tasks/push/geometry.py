"""The place from which a finger pushes a box to a goal, for rewards and planners."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

CONTACT_GAP = 0.015  # m: the radius of the finger's ball, which then nearly touches the box
OVER_THE_TOP = CONTACT_GAP + 0.02  # m from the top of a box to the middle of a finger that passes over it without touching
FULL_TURN = 0.3  # rad still to come, from which on a box is pushed as far beside its middle as is useful
OFF_THE_MIDDLE = 0.7  # of half of an edge: how far beside
FADE = 0.03  # m from the goal: within it the place counts less and less, because it jumps as the box passes the goal


def place_behind(box: Array, goal: Array, half_edges: Array, turn: Array | float = 0.0) -> Array:
    """Return the place from which the finger pushes the box straight to its goal, seen from above, (..., 2) m.

    It is opposite the goal, a contact gap outside the box: on the line that touches the box there, square to the push. A box
    that has to turn on the way is pushed beside its middle, counter-clockwise on the right side.

    Args:
        box: (..., 2) m, its centre.
        goal: (..., 2) m.
        half_edges: (..., 2) m, half of its edges along x and y. The orientation of the box is ignored.
        turn: (...,) rad, still to come.
    """
    gap = goal - box
    direction = gap / np.maximum(np.linalg.norm(gap, axis=-1, keepdims=True), 1e-6)
    extent = np.sum(np.abs(direction) * half_edges, axis=-1, keepdims=True)  # the support function of the rectangle
    share_of_turn = np.clip(np.asarray(turn) / FULL_TURN, -1.0, 1.0)[..., None]
    to_the_right = share_of_turn * OFF_THE_MIDDLE * half_edges.min(axis=-1, keepdims=True)
    place: Array = box - (extent + CONTACT_GAP) * direction + to_the_right * direction[..., ::-1] * [1.0, -1.0]
    return place


def climb(finger: Array, box: Array, goal: Array, half_edges: Array) -> Array:
    """Return how much higher a finger must be to pass over a box on its way behind it, (...,) m.

    The straight way leads through the box if the finger is above or before it. The result is zero if the finger is behind
    the box, or far enough beside it.

    Args:
        finger: (..., 3) m, centre of its ball.
        box: (..., 3) m, its centre.
        goal: (..., 2) m.
        half_edges: (..., 3) m, half of its edges. The orientation of the box is ignored.
    """
    gap = goal - box[..., :2]
    ahead = gap / np.maximum(np.linalg.norm(gap, axis=-1, keepdims=True), 1e-6)
    across = ahead[..., ::-1] * [-1.0, 1.0]
    aside = finger[..., :2] - box[..., :2]
    half = half_edges[..., :2]
    past = np.sum(aside * ahead + np.abs(ahead) * half, axis=-1)  # m before the rear of the box
    beside = np.abs(np.sum(aside * across, axis=-1)) - np.sum(np.abs(across) * half, axis=-1)  # m from its flank
    in_the_way = np.clip(past / CONTACT_GAP, 0.0, 1.0) * np.clip(2.0 - beside / CONTACT_GAP, 0.0, 1.0)
    higher: Array = in_the_way * np.maximum(0.0, box[..., 2] + half_edges[..., 2] + OVER_THE_TOP - finger[..., 2])
    return higher


def share(distance: Array) -> Array:
    """Return the weight of the way to the place behind the box, (...,) from 1 to 0, at distances (...,) m from the goal."""
    counts: Array = np.minimum(distance / FADE, 1.0)
    return counts
