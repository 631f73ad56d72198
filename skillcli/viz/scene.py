"""`Scene`: everything to show of one artifact, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import mujoco
import numpy as np

from skillcli.plaintext import line
from skillcli.tasks.spec import FigureSettings
from skillcli.trajectories import Array, Trajectories

LONGEST = 40  # characters of a name on a figure


class Runs(Enum):
    """What the episodes of a scene are."""

    SAMPLED = "each skill at its mean latent, then at latents drawn for it"
    BETWEEN = "each skill at its mean latent, then the means of two neighbours"
    PLANNED = "the routes of a composition"
    DOMAINS = "routes or skills, on robots drawn from one domain after the other"

    @property
    def held(self) -> bool:
        """Return whether every episode holds one latent from start to end."""
        return self in (Runs.SAMPLED, Runs.BETWEEN)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One artifact to be drawn. `E` episodes, `K` skills, `W` waypoints, latents of `d` components.

    Positions are in the frame of the robot's base. The free joint of a box in the model is named `box`.
    """

    title: str  # the artifact's id
    kind: str  # of the artifact
    runs: Runs
    task: str  # its name
    figure_settings: FigureSettings  # how the task is drawn
    provenance: str  # markdown
    trajectories: Trajectories
    model: mujoco.MjModel | None  # None if no engine simulates the task
    joints: tuple[str, ...]  # names of the arm's joints in the model
    skills: tuple[str, ...]  # (K,) names
    goals: Array  # (K, 3) m, the trained goals
    waypoints: Array  # (W, 3) m, of a composition, in order
    waypoint_route: Array  # (W,) route of each waypoint
    episode_route: Array  # (E,) route of each episode
    tolerance: float  # m, success radius
    means: Array  # (K, d) mean latents of the skills
    stds: Array  # (K, d)
    curves: Mapping[str, Array]  # learning curves by name, (iterations,) each; may be empty
    episode_labels: tuple[str, ...]  # (E,) such as "skill 1", "skill 1, latent 3", "nominal 0", "mild 4"
    intervals: Mapping[str, tuple[float, float, float]]  # per domain: success rate, and the ends of its interval
    # Skills trained with mixtures only:
    map_places: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) m, between the goals
    map_ends: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) m, where the map's latents for them end
    map_ends_on_robots: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) m, each on another robot
    # A transfer only:
    source: Trajectories | None = None  # (R episodes) what was sent, as recorded in the simulation
    episode_source: Array = field(
        default_factory=lambda: np.zeros(0, dtype=int)
    )  # (E,) episode of the source that each one repeats
    other_robot: str = ""  # file of the robot that ran the episodes, if it is not the source's
    source_model: mujoco.MjModel | None = None  # of the source, if `model` is the other robot's; None: `model` is the source's
    fingers: tuple[str, ...] = ()  # names of the slide joints of its hand, where they move
    source_joints: tuple[str, ...] = ()  # names of the arm's joints in the source's model
    parameters: Mapping[str, Array] = field(default_factory=dict)  # (E,) or (E, n); NaN: not varied by the domain
    pace: float = 1.0  # control steps of the source in one of these episodes: below one they are slower

    @property
    def drawn(self) -> bool:
        """Return whether `model` is of the arm that ran the episodes: another robot's file may be gone."""
        return not self.other_robot or self.source_model is not None

    def __post_init__(self) -> None:
        """Refuse labels and skills that do not match the arrays they name."""
        counts = {
            "episode_labels": (len(self.episode_labels), self.trajectories.episodes),
            "waypoint_route": (len(self.waypoint_route), len(self.waypoints)),
            "episode_route": (len(self.episode_route), self.trajectories.episodes),
            "goals": (len(self.goals), len(self.skills)),
            "means": (len(self.means), len(self.skills)),
            "stds": (len(self.stds), len(self.skills)),
        }
        if self.source is not None:
            counts["episode_source"] = (len(self.episode_source), self.trajectories.episodes)
        counts |= {name: (len(values), self.trajectories.episodes) for name, values in self.parameters.items()}
        for name, (got, expected) in counts.items():
            if got != expected:
                raise ValueError(f"scene {self.title}: {name} has {got} rows, expected {expected}")


def readable(scene: Scene) -> Scene:
    """Return the scene with names on one line each, without control characters."""
    return _renamed(scene, line, line, line)


def drawable(scene: Scene) -> Scene:
    """Return the scene with names that are not formulas, and not too long."""
    plain = readable(scene)
    return _renamed(plain, _short, label, lambda name: _success_of(name, plain.skills))


Rename = Callable[[str], str]


def _renamed(scene: Scene, short: Rename, long: Rename, curve: Rename) -> Scene:
    """Return the scene with other texts: those with little room, those with more, and names of curves."""
    return replace(
        scene,
        title=short(scene.title),
        skills=tuple(map(short, scene.skills)),
        episode_labels=tuple(map(long, scene.episode_labels)),
        intervals={long(name): interval for name, interval in scene.intervals.items()},
        other_robot=long(scene.other_robot),
        curves={curve(name): values for name, values in scene.curves.items()},
    )


def label(text: str) -> str:
    """Escape a text so that matplotlib draws it literally."""
    return line(text).replace("$", r"\$")


def _success_of(curve: str, skills: tuple[str, ...]) -> str:
    head, _, skill = curve.partition("/")
    return f"{head}/{_short(skill)}" if skill in skills else curve


def _short(text: str) -> str:
    return label(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")
