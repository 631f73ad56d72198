"""Figures of training: learning curves, and the resulting latent space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from skillcli.metrics import pairwise_distance
from skillcli.trajectories import Array
from skillcli.viz import subplots_time
from skillcli.viz.figure_style import WIDTH, blank, legend, skill_handles
from skillcli.viz.palette import TARGET, look
from skillcli.viz.scene import Scene

MAX_LIBRARIES = 4  # side by side


def curves(scenes: Sequence[Scene]) -> Figure:
    """Draw success and final distance over the control steps of training.

    Args:
        scenes: of pretrain artifacts with curves, at most `MAX_LIBRARIES`.
    """
    figure = blank(WIDTH, 3.5)
    grid = figure.subplots(2, len(scenes), squeeze=False, sharex="col")
    for column, scene in enumerate(scenes):
        _success(grid[0, column], scene)
        _distance(grid[1, column], scene)
        grid[0, column].set_title(_short(scene), fontsize=8)
    grid[0, 0].set_ylabel("success rate")
    grid[1, 0].set_ylabel(f"final distance {grid[1, 0].get_ylabel()}")
    most = max(len(scene.skills) for scene in scenes)
    mean = Line2D([], [], color="black", lw=1.6, label="mean")
    legend(figure, [*skill_handles(((skill, f"skill {skill + 1}") for skill in range(most)), marked=False), mean])
    return figure


def reward_terms(scenes: Sequence[Scene]) -> Figure:
    """Draw what each term of the reward gave per episode, over the control steps of training.

    Args:
        scenes: of pretrain artifacts with curves of the terms, at most `MAX_LIBRARIES`.
    """
    figure = blank(WIDTH, 2.6)
    for axes, scene in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes, strict=True):
        subplots_time.reward_curves(axes, scene)
        axes.set(ylabel="", xlabel=axes.get_xlabel().replace(" [", "\n["))
        axes.set_title(_short(scene), fontsize=8)
    figure.axes[0].set_ylabel("per episode")
    return figure


def _success(axes: Axes, scene: Scene) -> None:
    """Draw the success of each skill and of all."""
    for skill, name in enumerate(scene.skills):
        if (values := scene.curves.get(f"success/{name}")) is not None:
            axes.plot(_millions(scene, values), values, color=look(skill).color, ls=look(skill).dash, lw=0.7)
    if (values := scene.curves.get("success_rate")) is not None:
        axes.plot(_millions(scene, values), values, color="black", lw=1.6)
    axes.set_ylim(-0.02, 1.04)
    axes.grid(True)


def _distance(axes: Axes, scene: Scene) -> None:
    """Draw the mean final distance, with the tolerance."""
    scale, unit = subplots_time.unit(scene)
    values = scale * np.maximum(np.asarray(scene.curves["final_distance"], dtype=float), subplots_time.FLOOR)
    axes.plot(_millions(scene, values), values, color=TARGET, lw=1.1)
    axes.axhline(scale * scene.tolerance, color=TARGET, lw=0.8, ls=(0, (4, 3)))
    axes.set(
        yscale="log", xlabel="control steps\n[millions]" if "env_steps" in scene.curves else "iteration", ylabel=f"[{unit}]"
    )
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(True)


def _millions(scene: Scene, values: Array) -> Array:
    """Return the x values of a curve: millions of control steps if they were counted, else iterations."""
    steps = scene.curves.get("env_steps")
    over: Array = np.arange(len(values)) if steps is None or len(steps) != len(values) else np.asarray(steps) / 1e6
    return over


def distances(scenes: Sequence[Scene], correlations: Sequence[float | None]) -> Figure:
    """Compare distances between skills in the latent space with those between their goals.

    Args:
        scenes: of embed-means artifacts, at most `MAX_LIBRARIES`.
        correlations: Pearson r of each.
    """
    figure = blank(WIDTH, 2.3)
    for column, (scene, r) in enumerate(zip(scenes, correlations, strict=True)):
        axes = figure.add_subplot(1, len(scenes), column + 1)
        upper = np.triu_indices(len(scene.means), 1)
        latent, goal = pairwise_distance(scene.means)[upper], pairwise_distance(scene.goals)[upper]
        style = look(column)
        axes.plot(goal, latent, ls="none", marker=style.marker, color=style.color, ms=4, alpha=0.6, mew=0)
        axes.set(
            xlim=(0, 1.08 * goal.max()),
            ylim=(0, 1.08 * latent.max()),
            xlabel="between goals [m]",
            ylabel="between means" if column == 0 else "",
        )
        axes.set_title(_short(scene) + (f"\nr = {r:.2f}, n = {len(goal)}" if r is not None else f"\nn = {len(goal)}"))
        axes.grid(True)
    return figure


def _short(scene: Scene) -> str:
    """Return the library's name: the first part of its id."""
    return scene.title.split("/")[0]
