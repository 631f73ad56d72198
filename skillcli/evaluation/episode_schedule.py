"""The latents of a transfer's episodes: the routes of a composed plan in turn, or each skill's mean in turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from skillcli.composition.plan import Plan
from skillcli.evaluation.library import Library
from skillcli.kinds import kind_spec
from skillcli.store import Artifact
from skillcli.trajectories import Array


@dataclass(frozen=True)
class EpisodeSchedule:
    """Latents, skills and waypoints of E episodes."""

    latent: Array  # (E, T, d)
    skill: Array  # (E, T)
    steps: Array  # (E,) control steps of each episode
    waypoints: tuple[Array, ...]  # (W, 3) m of each episode; for bare skills the goal alone

    @property
    def episodes(self) -> int:
        """Return the number of episodes, E."""
        return len(self.latent)

    @staticmethod
    def of(source: Artifact, library: Library) -> EpisodeSchedule:
        """Make the schedule of an artifact with a plan, or of bare skills; one episode per route or skill."""
        if kind_spec(source.kind).holds("plan"):
            return EpisodeSchedule.of_plan(source.arrays, library.recipe.task.control_period)
        horizon = library.recipe.task.horizon
        latents = np.repeat(library.mean[:, None], horizon, axis=1)
        skills = np.repeat(np.arange(len(library.mean))[:, None], horizon, axis=1)
        return EpisodeSchedule(latents, skills, np.full(len(latents), horizon), tuple(goal[None] for goal in library.goals))

    @staticmethod
    def of_plan(arrays: Mapping[str, Array], period: float) -> EpisodeSchedule:
        """Make the schedule of a plan from the arrays of a composition, with control steps of `period` s."""
        plan = Plan.read(arrays, period)
        target, route = arrays["waypoints/target"], arrays["waypoints/route"]
        waypoints = tuple(target[route == index] for index in range(len(plan.routes)))
        return EpisodeSchedule(*plan.schedules(), waypoints)

    def in_turn(self, episodes: int) -> EpisodeSchedule:
        """Repeat the episodes in order until there are this many."""
        turn = np.arange(episodes) % self.episodes
        return EpisodeSchedule(
            self.latent[turn], self.skill[turn], self.steps[turn], tuple(self.waypoints[index] for index in turn)
        )
