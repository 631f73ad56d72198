"""Where a finger has to be to push a box: what rewards lead it to, and what planners count the way to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

CONTACT_GAP = 0.015  # m: the radius of the finger's ball, which then nearly touches the box
OVER_THE_TOP = CONTACT_GAP + 0.02  # m from the top of a box to the middle of a finger that passes over it without touching
FADE = 0.03  # m from its goal within which that place, which jumps as the box passes the goal, counts less and less


def place_behind(box: Array, goal: Array, half_edges: Array) -> Array:
    """Where the finger pushes the box straight at its goal, seen from above, (..., 2) m.

    On the far side from the goal, a contact gap outside the box: behind the line that touches it there, square to the push.

    Args:
        box: (..., 2) m, its centre.
        goal: (..., 2) m.
        half_edges: (..., 2) m, half of its edges along x and y. How the box has turned is left out.
    """
    gap = goal - box
    direction = gap / np.maximum(np.linalg.norm(gap, axis=-1, keepdims=True), 1e-6)
    extent = np.sum(np.abs(direction) * half_edges, axis=-1, keepdims=True)  # the support function of the rectangle
    place: Array = box - (extent + CONTACT_GAP) * direction
    return place


def climb(finger: Array, box: Array, goal: Array, half_edges: Array) -> Array:
    """How much higher a finger has to be to pass over a box on its way behind it, (...,) m.

    The way straight there leads through the box where the finger is above or before it. Nothing where the finger is behind
    the box, or beside it far enough to go round.

    Args:
        finger: (..., 3) m, centre of its ball.
        box: (..., 3) m, its centre.
        goal: (..., 2) m.
        half_edges: (..., 3) m, half of its edges. How the box has turned is left out.
    """
    gap = goal - box[..., :2]
    ahead = gap / np.maximum(np.linalg.norm(gap, axis=-1, keepdims=True), 1e-6)
    across = ahead[..., ::-1] * [-1.0, 1.0]
    aside = finger[..., :2] - box[..., :2]
    half = half_edges[..., :2]
    past = np.sum(aside * ahead + np.abs(ahead) * half, axis=-1)  # m before the rear of the box
    beside = np.abs(np.sum(aside * across, axis=-1)) - np.sum(np.abs(across) * half, axis=-1)  # m off its flank
    in_the_way = np.clip(past / CONTACT_GAP, 0.0, 1.0) * np.clip(2.0 - beside / CONTACT_GAP, 0.0, 1.0)
    higher: Array = in_the_way * np.maximum(0.0, box[..., 2] + half_edges[..., 2] + OVER_THE_TOP - finger[..., 2])
    return higher


def share(distance: Array) -> Array:
    """How much the way to the place behind the box counts at a distance (...,) m from the goal: from 1 to 0, (...,)."""
    counts: Array = np.minimum(distance / FADE, 1.0)
    return counts
