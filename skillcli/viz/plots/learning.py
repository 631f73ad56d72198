"""Figures of the training: how fast it learns, and what the latent space is like then."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from skillcli.metrics import pairwise_distance
from skillcli.viz import panels_time
from skillcli.viz.canvas import WIDTH, blank, legend, skill_handles
from skillcli.viz.palette import TARGET, look
from skillcli.viz.scene import Scene

MAX_LIBRARIES = 4  # side by side


def curves(scenes: Sequence[Scene]) -> Figure:
    """Success and final distance over the control steps of the training.

    Args:
        scenes: of pretrain artifacts with curves, at most `MAX_LIBRARIES`.
    """
    drawn = blank(WIDTH, 3.6)
    grid = drawn.subplots(2, len(scenes), squeeze=False, sharex="col")
    for column, scene in enumerate(scenes):
        panels_time.success_curves(grid[0, column], scene)
        grid[0, column].set(title=_short(scene), xlabel="", ylabel="success rate" if column == 0 else "")
        scale, unit = panels_time.unit(scene)
        steps = np.asarray(scene.curves.get("env_steps", ())) / 1000
        values = scale * np.maximum(np.asarray(scene.curves["final_distance"], dtype=float), panels_time.FLOOR)
        axes = grid[1, column]
        axes.plot(steps if len(steps) == len(values) else np.arange(len(values)), values, color=TARGET)
        axes.axhline(scale * scene.tolerance, color=TARGET, lw=0.8, ls=(0, (4, 3)))
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_formatter("")
        axes.set(xlabel="control steps\n[thousands]" if len(steps) == len(values) else "iteration")
        axes.set_ylabel(f"{'final distance ' if column == 0 else ''}[{unit}]")
        axes.grid(True)
    most = max(scenes, key=lambda scene: len(scene.skills))
    legend(drawn, [*skill_handles((skill, f"skill {skill + 1}") for skill in range(len(most.skills)))])
    for handle in drawn.legends[0].legend_handles:
        if handle is not None:
            handle.set(marker="")
    return drawn


def distances(scenes: Sequence[Scene], correlations: Sequence[float | None]) -> Figure:
    """Distances between skills in the latent space against those between their goals: is there a metric?

    Args:
        scenes: of embed-means artifacts, at most `MAX_LIBRARIES`.
        correlations: Pearson r of each.
    """
    drawn = blank(WIDTH, 2.3)
    for column, (scene, r) in enumerate(zip(scenes, correlations, strict=True)):
        axes = drawn.add_subplot(1, len(scenes), column + 1)
        upper = np.triu_indices(len(scene.means), 1)
        latent, goal = pairwise_distance(scene.means)[upper], pairwise_distance(scene.goals)[upper]
        style = look(column)
        axes.plot(goal, latent, ls="none", marker=style.marker, color=style.color, ms=4, alpha=0.6, mew=0)
        axes.set(xlim=(0, None), ylim=(0, None), xlabel="between goals [m]", ylabel="between means" if column == 0 else "")
        axes.set_title(_short(scene) + (f"\nr = {r:.2f}, n = {len(goal)}" if r is not None else f"\nn = {len(goal)}"))
        axes.grid(True)
    return drawn


def _short(scene: Scene) -> str:
    """Whose library it is: the first part of its id."""
    return scene.title.split("/")[0]
