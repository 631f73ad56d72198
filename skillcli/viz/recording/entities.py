"""Names of entities, colours of skills and the extent of the scene, shared by the parts of a recording."""

from __future__ import annotations

import re

import numpy as np

from skillcli.trajectories import Array
from skillcli.viz import kinematics, motion
from skillcli.viz.palette import BETWEEN, look
from skillcli.viz.scene import Runs, Scene


def key(scene: Scene, episode: int) -> str:
    """Return an episode as one part of an entity path: sorted by number, readable by label."""
    return f"{episode:03d}-{slug(scene.episode_labels[episode])}"


def slug(text: str) -> str:
    """Turn any text into one part of an entity path that needs no escapes."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", text).strip("-") or "unnamed"


def group(scene: Scene, episode: int) -> str:
    """Return the folder of an episode's path: its domain in a transfer, its skill if one skill ran, else "composed"."""
    if scene.runs is Runs.DOMAINS:
        return slug(motion.domain(scene.episode_labels[episode]))
    if scene.runs is Runs.PLANNED:
        return "composed"
    skill = motion.episode_skill(scene, episode)
    return slug(scene.skills[skill]) if skill >= 0 else "no-skill"


def called(scene: Scene) -> list[str]:
    """Return the names of the skills in space, (K,): a bare number could be that of a waypoint."""
    return [f"skill {name}" if name.isdecimal() else name for name in scene.skills]


def skill_colors(scene: Scene) -> list[str]:
    """Return one colour per skill, (K,)."""
    return [look(k).color for k in range(len(scene.skills))]


def episode_color(scene: Scene, episode: int) -> str:
    """Return the colour of an episode: its domain's in a transfer, else its skill's."""
    if scene.runs is Runs.DOMAINS:
        return look(list(motion.domains(scene)).index(motion.domain(scene.episode_labels[episode]))).color
    first = motion.pieces(scene, episode)
    return look(first[0].skill).color if len(first) == 1 else BETWEEN


def curve_path(name: str) -> str:
    """Return the entity of a learning curve: "success/skill 1" is success/skill-1."""
    return "/".join(slug(part) for part in name.split("/"))


def in_space(latent: Array) -> Array:
    """Return the first three components of latents, (n, d) → (n, 3), padded with zeros."""
    padded = np.zeros((len(latent), 3))
    shown = min(3, latent.shape[-1])
    padded[:, :shown] = latent[:, :shown]
    return padded


def spread(scene: Scene) -> Array:
    """Return the points that must be visible, (n, 3) m."""
    paths = [motion.path(scene, episode) for episode in range(scene.trajectories.episodes)]
    base: list[Array] = []
    if scene.model is not None and scene.trajectories.joint_position is not None:
        base = [kinematics.body_poses(scene.model, scene.joints, scene.trajectories.joint_position[0, :1])[0][0, 1:]]
    return np.concatenate([scene.goals.reshape(-1, 3), scene.waypoints.reshape(-1, 3), *paths, *base])


def extent(scene: Scene) -> float:
    """Return the diagonal of the points that must be visible, m."""
    points = spread(scene)
    return float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0


def latent_extent(scene: Scene) -> float:
    """Return the diagonal of the skills' latents with their spread."""
    corners = np.concatenate([scene.means - scene.stds, scene.means + scene.stds])
    return float(np.linalg.norm(np.ptp(corners, axis=0))) if len(corners) else 1.0
