"""Figures of latents between two skills."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from skillcli.metrics import neighbours
from skillcli.trajectories import Array
from skillcli.viz.figure_style import WIDTH, blank, legend
from skillcli.viz.palette import BETWEEN, COLORS, TARGET


def calibration(pair: Array, share: Array, end: Array, goals: Array) -> Figure:
    """Draw how far along the way between two goals a held latent between two skills leads.

    Args:
        pair: (P, 2) skills.
        share: (S,) of the way from the first mean to the second.
        end: (P, S, 3) m, where the motion ends.
        goals: (K, 3) m.
    """
    near = set(neighbours(goals))
    figure = blank(WIDTH, 2.7)
    along, off = figure.subplots(1, 2)
    for (a, b), ends in sorted(zip(pair.tolist(), end, strict=True), key=lambda found: tuple(found[0]) in near):
        way = goals[b] - goals[a]
        fraction = (ends - goals[a]) @ way / (way @ way)
        aside = 100 * np.linalg.norm(ends - goals[a] - fraction[:, None] * way, axis=1)
        neighbour = (a, b) in near
        style = {"color": COLORS[0] if neighbour else BETWEEN, "ls": "-" if neighbour else ":", "lw": 1.1 if neighbour else 0.7}
        along.plot(share, fraction, **style)
        off.plot(share, aside, **style)
    along.plot([0, 1], [0, 1], color=TARGET, lw=1.4, ls="--")
    along.set(xlabel="share λ of the second latent", ylabel="fraction of the way", title="along the line between the goals")
    off.set(xlabel="share λ of the second latent", ylabel="distance from the line [cm]", title="away from it", ylim=(0, None))
    for axes in (along, off):
        axes.grid(True)
    lines = [
        Line2D([], [], color=COLORS[0], lw=1.1, label="neighbouring skills"),
        Line2D([], [], color=BETWEEN, lw=0.7, ls=":", label="other pairs"),
        Line2D([], [], color=TARGET, lw=1.4, ls="--", label="a metric would give this"),
    ]
    legend(figure, [*lines])
    return figure
