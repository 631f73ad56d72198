"""What is fed to the episodes of a transfer: the routes of a composed plan in turn, or each skill's mean in turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli.composition.plan import Plan
from skillcli.evaluation.library import Library
from skillcli.kinds import kind_spec
from skillcli.store import Artifact
from skillcli.trajectories import Array


@dataclass(frozen=True)
class EpisodeSchedule:
    """E episodes."""

    latent: Array  # (E, T, d)
    skill: Array  # (E, T)
    steps: Array  # (E,) control steps of each episode
    waypoints: tuple[Array, ...]  # (W, 3) m of each episode, the goal alone for bare skills

    @property
    def episodes(self) -> int:
        """How many there are, E."""
        return len(self.latent)

    @staticmethod
    def of(source: Artifact, library: Library) -> EpisodeSchedule:
        """The script of an artifact that holds a plan, or of the skills of any other; one episode of each route or skill."""
        if kind_spec(source.kind).holds("plan"):
            plan = Plan.read(source.arrays, library.recipe.task.control_period)
            target, route = source.arrays["waypoints/target"], source.arrays["waypoints/route"]
            waypoints = tuple(target[route == index] for index in range(len(plan.routes)))
            return EpisodeSchedule(*plan.schedules(), waypoints)
        horizon = library.recipe.task.horizon
        latents = np.repeat(library.mean[:, None], horizon, axis=1)
        skills = np.repeat(np.arange(len(library.mean))[:, None], horizon, axis=1)
        return EpisodeSchedule(latents, skills, np.full(len(latents), horizon), tuple(goal[None] for goal in library.goals))

    def in_turn(self, episodes: int) -> EpisodeSchedule:
        """Each episode again and again, until there are this many."""
        turn = np.arange(episodes) % self.episodes
        return EpisodeSchedule(
            self.latent[turn], self.skill[turn], self.steps[turn], tuple(self.waypoints[index] for index in turn)
        )
