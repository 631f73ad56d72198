"""Figures of learned composers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from skillcli.seeding import generator
from skillcli.trajectories import Array
from skillcli.viz.figure_style import WIDTH, blank
from skillcli.viz.palette import look

DRAWS = 2000


def arm_returns(arms: Mapping[str, tuple[Array, Array]], unit: str) -> Figure:
    """Draw the return of a composer without exploration while it learns, by the set of latents (paper figure 10).

    Args:
        arms: by name: (I,) thousands of control steps, and (R, I) returns of R runs.
        unit: name of the return.
    """
    figure = blank(WIDTH, 2.8)
    axes = figure.subplots()
    for index, (name, (steps, returns)) in enumerate(arms.items()):
        style, every = look(index), max(1, len(steps) // 8)
        low, high = bootstrap(returns)
        axes.fill_between(steps, low, high, color=style.color, alpha=0.15, lw=0)
        label = f"{name} ({len(returns)} run{'s' * (len(returns) != 1)})"
        axes.plot(
            steps,
            returns.mean(axis=0),
            color=style.color,
            ls=style.dash,
            marker=style.marker,
            ms=4,
            markevery=every,
            label=label,
        )
    axes.set(xlabel="control steps [thousands]", ylabel=unit)
    axes.grid(True)
    axes.legend(loc="lower right", title="latents to choose from")
    return figure


def bootstrap(samples: Array, draws: int = DRAWS) -> tuple[Array, Array]:
    """Compute the 95 % percentile interval of the mean over the first axis (Efron 1979), (R, I) to two of (I,)."""
    chosen = generator(0, "bootstrap").integers(len(samples), size=(draws, len(samples)))
    low, high = np.quantile(samples[chosen].mean(axis=1), [0.025, 0.975], axis=0)
    return low, high
