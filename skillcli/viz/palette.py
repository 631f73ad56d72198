"""One look per skill, told apart by colour, line style and marker, so that it survives a grey printer.

The colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/), readable with any colour vision; yellow and
black are replaced because one is lost on white paper and the other on the viewer's dark ground.
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
TARGET_IN_VIEWER = "#E8E8E8"  # the same on the viewer's dark ground


class Look(NamedTuple):
    """How one series is drawn."""

    color: str
    dash: Dash
    marker: str


def look(index: int) -> Look:
    """The look of skill (or domain) `index`; -1 is the look of an interpolated latent.

    After eight entries the colours repeat with other dashes, so 32 stay distinct.
    """
    if index < 0:
        return Look(BETWEEN, ":", ".")
    turn, slot = divmod(index, len(COLORS))
    return Look(COLORS[slot], DASHES[(slot + turn) % len(DASHES)], MARKERS[(slot + turn) % len(MARKERS)])


def fed_look(skill: int, latent: Array, means: Array) -> Look:
    """The look of a latent (d,) that is fed: its skill's, or between skills a mix of the two colours whose means (K, d) are
    nearest, the nearer the more."""
    if skill >= 0 or len(means) < 2:
        return look(skill)
    distance = np.linalg.norm(means - latent, axis=1)
    first, second = (int(k) for k in np.argsort(distance, kind="stable")[:2])
    share = distance[second] / max(distance[first] + distance[second], 1e-12)  # of the nearer one
    nearer, farther = (np.array(rgba(look(k).color)[:3]) for k in (first, second))
    mixed = np.round(share * nearer + (1 - share) * farther).astype(int)
    return Look("#{:02X}{:02X}{:02X}".format(*mixed), ":", ".")


def rgba(color: str, alpha: float = 1.0) -> tuple[int, int, int, int]:
    """A hexadecimal colour as bytes."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue, round(255 * alpha)
