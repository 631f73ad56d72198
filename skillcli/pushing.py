"""Where a finger has to be to push a box: what rewards lead it to, and what planners count the way to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

CONTACT_GAP = 0.015  # m: the radius of the finger's ball, which then nearly touches the box
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


def share(distance: Array) -> Array:
    """How much the way to the place behind the box counts at a distance (...,) m from the goal: from 1 to 0, (...,)."""
    counts: Array = np.minimum(distance / FADE, 1.0)
    return counts
