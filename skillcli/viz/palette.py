"""One style per skill: colour, dashes and marker differ, so that skills can be distinguished in grey print.

The colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/), readable with any colour vision. Yellow and black
are replaced: one is invisible on white paper, the other on the viewer's dark background.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from skillcli.trajectories import Array

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7A52C7", "#8C6D31")
Dash = Literal["-", "--", "-.", ":"]

DASHES: tuple[Dash, ...] = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

BETWEEN = "#7F7F7F"  # a latent that is no skill's mean
TARGET = "#2B2B2B"  # waypoints and tolerances on paper
TARGET_IN_VIEWER = "#E8E8E8"  # the same on the viewer's dark background


class Look(NamedTuple):
    """How one series is drawn."""

    color: str
    dash: Dash
    marker: str


def look(index: int) -> Look:
    """Return the style of skill (or domain) `index`; -1 is a latent between skills.

    After eight entries the colours repeat with other dashes, so 32 are distinct.
    """
    if index < 0:
        return Look(BETWEEN, ":", ".")
    turn, slot = divmod(index, len(COLORS))
    return Look(COLORS[slot], DASHES[(slot + turn) % len(DASHES)], MARKERS[(slot + turn) % len(MARKERS)])


def latent_look(skill: int, latent: Array, means: Array) -> Look:
    """Return the style of a latent (d,): that of its skill, or between skills a mix of the colours of the two nearest means
    (K, d), weighted by nearness."""
    if skill >= 0 or len(means) < 2:
        return look(skill)
    distance = np.linalg.norm(means - latent, axis=1)
    first, second = (int(k) for k in np.argsort(distance, kind="stable")[:2])
    share = distance[second] / max(distance[first] + distance[second], 1e-12)  # weight of the nearer one
    nearer, farther = (np.array(rgba(look(k).color)[:3]) for k in (first, second))
    mixed = np.round(share * nearer + (1 - share) * farther).astype(int)
    return Look("#{:02X}{:02X}{:02X}".format(*mixed), ":", ".")


def rgba(color: str, alpha: float = 1.0) -> tuple[int, int, int, int]:
    """Convert a hexadecimal colour to bytes."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue, round(255 * alpha)
