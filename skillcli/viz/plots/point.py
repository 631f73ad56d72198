"""Figures of the point task."""

from __future__ import annotations

from matplotlib.figure import Figure

from skillcli.viz import motion, panels_space
from skillcli.viz.canvas import WIDTH, blank, legend, mark, skill_handles
from skillcli.viz.palette import look
from skillcli.viz.scene import Scene


def latents_and_paths(scene: Scene) -> Figure:
    """The density of every skill in the latent space, and the paths that its latents give (paper figure 2).

    Args:
        scene: of a pretrain artifact with two latent components.
    """
    drawn = blank(WIDTH, 3.3)
    left, right = drawn.subplots(1, 2)
    panels_space.latents(left, scene, (0, 1))
    for episode in range(scene.trajectories.episodes):
        latent, style = scene.trajectories.latent[episode, 0], look(motion.episode_skill(scene, episode))
        left.plot(latent[0], latent[1], ls="none", marker=".", ms=3, mew=0, color=style.color, alpha=0.7, zorder=3)
    left.set_title(r"p(z | skill): 1$\sigma$, 2$\sigma$ and sampled latents")
    panels_space.paths(right, scene, (0, 1))
    panels_space.goals(right, scene, (0, 1))
    right.set_title("paths from the origin")
    names = [(skill, f"skill {panels_space.numbered(scene, skill)}") for skill in range(len(scene.skills))]
    legend(drawn, [*skill_handles(names), mark("start", "o", "white")])
    return drawn
