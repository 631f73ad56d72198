"""What there is to show: plain data of one artifact, handed over by a stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import mujoco
import numpy as np

from skillcli.plaintext import line
from skillcli.tasks.spec import Drawing
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
        """Whether every episode holds one latent from the start to the end."""
        return self in (Runs.SAMPLED, Runs.BETWEEN)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One artifact as it is drawn. `E` episodes, `K` skills, `W` waypoints, latents of `d` components.

    Positions are in the frame of the robot's base. In the model the free joint of the box, where there is one, is named `box`.
    """

    title: str  # the artifact's id
    kind: str  # of the artifact
    runs: Runs
    task: str  # its name
    drawing: Drawing  # how the task is drawn
    provenance: str  # markdown
    trajectories: Trajectories
    model: mujoco.MjModel | None  # None where no engine simulates the task
    joints: tuple[str, ...]  # of the arm, as the model names them
    skills: tuple[str, ...]  # (K,) names
    goals: Array  # (K, 3) m, the trained goals
    waypoints: Array  # (W, 3) m, what a composition had to reach, in order
    waypoint_route: Array  # (W,) which of the composition's routes each belongs to
    episode_route: Array  # (E,) which of them each episode ran
    tolerance: float  # m, success radius
    means: Array  # (K, d) of the skills' latents
    stds: Array  # (K, d)
    curves: Mapping[str, Array]  # learning curves by name, (iterations,) each; may be empty
    episode_labels: tuple[str, ...]  # (E,) such as "skill 1", "skill 1, latent 3", "nominal 0", "mild 4"
    intervals: Mapping[str, tuple[float, float, float]]  # per domain: success rate, its low and high end
    # A transfer only:
    source: Trajectories | None = None  # (R episodes) what was sent, as it went in the simulation it was made in
    episode_source: Array = field(default_factory=lambda: np.zeros(0, dtype=int))  # (E,) which of those each episode repeats
    other_robot: str = ""  # the file of the robot that episodes ran on where that is not `model`, whose joints would bend it
    drawn: Mapping[str, Array] = field(default_factory=dict)  # parameters, (E,) or (E, n); NaN: the domain leaves it alone

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
        counts |= {name: (len(values), self.trajectories.episodes) for name, values in self.drawn.items()}
        for name, (got, expected) in counts.items():
            if got != expected:
                raise ValueError(f"scene {self.title}: {name} has {got} rows, expected {expected}")


def readable(scene: Scene) -> Scene:
    """A scene whose names are one line each, in which nothing acts."""
    return _renamed(scene, line, line, line)


def drawable(scene: Scene) -> Scene:
    """The same with names that are no formulas, nor endless."""
    plain = readable(scene)
    return _renamed(plain, _short, label, lambda name: _success_of(name, plain.skills))


Rename = Callable[[str], str]


def _renamed(scene: Scene, short: Rename, long: Rename, curve: Rename) -> Scene:
    """A scene with other texts: those with little room, those with more, and names of curves."""
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
    """Text as matplotlib has to be given it to draw it as it is."""
    return line(text).replace("$", r"\$")


def _success_of(curve: str, skills: tuple[str, ...]) -> str:
    head, _, skill = curve.partition("/")
    return f"{head}/{_short(skill)}" if skill in skills else curve


def _short(text: str) -> str:
    return label(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")
