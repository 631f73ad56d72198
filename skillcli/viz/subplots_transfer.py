"""Subplots that compare domains."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from skillcli.metrics import final_distance
from skillcli.viz import motion
from skillcli.viz.palette import TARGET, look
from skillcli.viz.scene import Scene
from skillcli.viz.subplots_time import unit


def entitle(axes: Axes, scene: Scene, name: str, episodes: list[int]) -> None:
    """Title a domain's map with its name and counts."""
    won, broken = int(scene.trajectories.success[episodes].sum()), int((~scene.trajectories.stable[episodes]).sum())
    axes.set_title(f"{name}: {won} of {len(episodes)} succeed" + (f", {broken} unstable" if broken else ""))


def _rows(axes: Axes, scene: Scene) -> dict[str, list[int]]:
    """Label the vertical axis with the domains, the first on top, and their number of episodes."""
    groups = motion.domains(scene)
    names = [f"{name}\nn = {len(episodes)}" for name, episodes in groups.items()]
    axes.set_yticks(range(len(groups)), names)
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")
    return groups


def success(axes: Axes, scene: Scene) -> None:
    """Draw the success rate per domain with its interval."""
    for row, name in enumerate(_rows(axes, scene)):
        if name not in scene.intervals:
            continue
        (rate, low, high), style = scene.intervals[name], look(row)
        if high > low:  # else nothing is random: the rate is exact
            axes.plot([low, high], [row, row], color=style.color, lw=2.2, solid_capstyle="butt")
            axes.plot([low, high], [row, row], color=style.color, ls="none", marker="|", ms=9, mew=1.2)
        axes.plot(rate, row, color=style.color, marker=style.marker, ms=7, mec="white", mew=0.8)
        told = f"{100 * rate:.0f} %" if high > low else f"{100 * rate:.0f} %, exact"
        axes.annotate(told, (rate, row), xytext=(0, 8), textcoords="offset points", ha="center")
    axes.set(xlim=(-0.03, 1.03), xlabel="success rate", title="success (bar: 95 % Wilson interval)")


def final_distances(axes: Axes, scene: Scene) -> None:
    """Draw the final distance of every stable episode, quartiles as a box and the median as a line."""
    scale, name = unit(scene)
    gaps = scale * final_distance(scene.trajectories)
    for row, episodes in enumerate(_rows(axes, scene).values()):
        values, style = np.sort(gaps[episodes][scene.trajectories.stable[episodes]]), look(row)
        if not len(values):
            continue
        # a fixed low-discrepancy spread, so that equal data give equal figures
        spread = 0.5 * ((np.arange(len(values)) * 0.618034) % 1 - 0.5)
        axes.plot(values, row + spread, color=style.color, marker=style.marker, ls="none", ms=3.5, alpha=0.55, mew=0)
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        axes.fill_between([low, high], row - 0.32, row + 0.32, fc="none", ec=TARGET, lw=0.8)
        axes.plot([middle, middle], [row - 0.32, row + 0.32], color=TARGET, lw=1.8)
    tolerance = scale * scene.tolerance
    axes.axvline(tolerance, color=TARGET, lw=0.8, ls=(0, (4, 3)))
    axes.annotate(
        "tolerance",
        (tolerance, 1),
        xycoords=("data", "axes fraction"),
        xytext=(3, -2),
        textcoords="offset points",
        va="top",
        fontsize=7,
        color=TARGET,
    )
    axes.set(xlim=(0, None), xlabel=f"final distance to the target [{name}]", title="final distance (box: quartiles)")
