"""Figures of the point task."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from skillcli.viz import motion, subplots_space
from skillcli.viz.figure_style import WIDTH, blank, legend, mark, skill_handles
from skillcli.viz.palette import look
from skillcli.viz.scene import Scene

ENLARGED = 4  # skills whose density is also enlarged
HALF_WIDTH = 4.0  # standard deviations to each side when enlarged


def latents_and_paths(scene: Scene) -> Figure:
    """Draw the density of every skill in the latent space, and the paths of its latents (paper figure 2).

    Args:
        scene: of a pretrain artifact with two latent components.
    """
    figure = blank(WIDTH, 2.7)
    columns = figure.add_gridspec(1, 3, width_ratios=[1, 0.8, 1])
    everywhere, paths = figure.add_subplot(columns[0]), figure.add_subplot(columns[2])
    subplots_space.latents(everywhere, scene, (0, 1))
    everywhere.set_title("latent space: means")
    shown = range(min(len(scene.skills), ENLARGED))
    grid = columns[1].subgridspec(2, 2)
    for skill in shown:
        _density(figure.add_subplot(grid[skill // 2, skill % 2]), scene, skill)
    subplots_space.paths(paths, scene, (0, 1))
    subplots_space.goals(paths, scene, (0, 1))
    paths.set_title("paths from the origin")
    names = [(skill, f"skill {subplots_space.numbered(scene, skill)}") for skill in range(len(scene.skills))]
    legend(figure, [*skill_handles(names), mark("start", "o", "white"), mark("sampled", ".")])
    return figure


def _density(axes: Axes, scene: Scene, skill: int) -> None:
    """Enlarge one skill's Gaussian: one and two standard deviations, and the latents drawn from it."""
    style, mean, std = look(skill), *subplots_space.components(np.stack([scene.means[skill], scene.stds[skill]]), (0, 1))
    for scale, alpha in ((2, 0.15), (1, 0.3)):
        axes.add_patch(Ellipse((0.0, 0.0), *(2 * scale * std), fc=style.color, ec=style.color, ls=style.dash, alpha=alpha))
    at_mean = motion.mean_episodes(scene).get(skill)
    for episode in range(scene.trajectories.episodes):
        if episode != at_mean and motion.episode_skill(scene, episode) == skill:
            (latent,) = subplots_space.components(scene.trajectories.latent[episode, :1], (0, 1))
            axes.plot(*(latent - mean), color="black", marker=".", ms=3, ls="none")
    reach = HALF_WIDTH * float(np.max(scene.stds[:, :2]))
    tick = float(f"{reach / 2:.1g}")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", yticks=[])
    axes.set_xticks([-tick, tick], [f"−{tick:g}", f"{tick:g}"], fontsize=6)
    axes.set_title(rf"{skill + 1}: 1$\sigma$, 2$\sigma$", fontsize=7)
