"""Run episodes on robots that differ: conditioned on latents, with replanning, or with the source's actions sent blindly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from skillcli.config.randomization import Distribution, repeats, sample_each
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library
from skillcli.evaluation.replanning import Replanner
from skillcli.evaluation.rollouts import rollout, rollout_waypoints
from skillcli.seeding import generator
from skillcli.simulation.domains import Domain
from skillcli.simulation.environment import NO_SKILL, Environment
from skillcli.tasks.world import MAX_SIMULATIONS, World, randomize_and_reset
from skillcli.trajectories import Array, Trajectories

OnEpisode = Callable[[int, int], None]  # called before each replanned episode with its number and how many there are


@dataclass(frozen=True)
class TargetRobots:
    """A domain and the parameters drawn from it for each episode."""

    name: str
    parameters: dict[str, Array]  # (E,) or (E, n) by name, see `skillcli.config.randomization`
    ranges: Mapping[str, Distribution] = field(default_factory=dict)  # distributions of the parameters
    episodes: int = 1  # E

    @staticmethod
    def drawn(domain: Domain, episodes: int, seed: int, joints: int, use: str = "domain") -> TargetRobots:
        """Draw by domain, seed and use only: every plan meets the same robots, and more episodes begin with the same ones."""
        rngs = [generator(seed, f"{use} {domain.name} {episode}") for episode in range(episodes)]
        return TargetRobots(domain.name, sample_each(domain.parameters, rngs, joints), domain.parameters, episodes)

    @property
    def repeats(self) -> bool:
        """Return whether all episodes are the same."""
        return self.parameters.keys() <= self.ranges.keys() and repeats(self.ranges)

    def first(self, episodes: int) -> TargetRobots:
        """Return the first of the robots."""
        kept = {name: values[:episodes] for name, values in self.parameters.items()}
        return replace(self, parameters=kept, episodes=episodes)

    def only(self, names: Iterable[str]) -> TargetRobots:
        """Return the same robots with every parameter nominal except these."""
        kept = list(names)
        ranges = {name: self.ranges[name] for name in kept if name in self.ranges}
        return replace(self, parameters={name: self.parameters[name] for name in kept}, ranges=ranges)


NOMINAL = TargetRobots("nominal", {})


@dataclass(frozen=True)
class TransferEvaluator:
    """Runs episodes.

    Attributes:
        library: the skills.
        seed: of sensor noise, disturbances and planning.
        world: the task on the robot to evaluate.
        replanner: plans again during an episode; None executes the schedule open loop.
    """

    library: Library
    seed: int
    world: World
    replanner: Replanner | None = None

    def check(self) -> None:
        """Refuse a robot that does not fit the task, before any work.

        Raises:
            UsageError: it does not fit.
        """
        self.world.make_env(1)

    def run(self, schedule: EpisodeSchedule, target: TargetRobots, on_episode: OnEpisode = lambda *_: None) -> Trajectories:
        """Execute a schedule on a target, one episode each; call `on_episode` before every episode with replanning."""
        if self.replanner is not None:
            return self._replan(self.replanner, schedule, target, on_episode)

        def rollout_part(env: Environment, part: slice) -> Trajectories:
            act, latent, skill = self.library.agent.act, schedule.latent[part], schedule.skill[part]
            return rollout_waypoints(env, act, latent, skill, schedule.waypoints[part], schedule.steps[part])

        return self._side_by_side(schedule.episodes, target, rollout_part)

    def replay(self, source: Trajectories, target: TargetRobots, episodes: int) -> Array:
        """Send the source's actions in turn and return the distance between the ends on target and source, (E,) m."""
        turn = np.arange(episodes) % source.episodes
        actions = source.action / self.world.action_scale

        def send(env: Environment, part: slice) -> Trajectories:
            which = turn[part]
            env.desired_goal[:] = source.achieved_goal[which, source.length[which]]
            return rollout(env, lambda _, action: action, actions[which], source.skill[which], source.length[which])[0]

        sent = self._side_by_side(episodes, target, send)
        end = sent.achieved_goal[np.arange(episodes), sent.length]
        error: Array = np.linalg.norm(end - source.achieved_goal[turn, source.length[turn]], axis=1)
        return error

    def _side_by_side(
        self, episodes: int, target: TargetRobots, rollout_part: Callable[[Environment, slice], Trajectories]
    ) -> Trajectories:
        recordings = []
        for first in range(0, episodes, MAX_SIMULATIONS):
            part = slice(first, min(first + MAX_SIMULATIONS, episodes))
            parameters = {name: values[part] for name, values in target.parameters.items()}
            skill = np.full(part.stop - first, NO_SKILL)
            sensors = [generator(self.seed, f"sensors {target.name} {episode}") for episode in range(first, part.stop)]
            recordings.append(rollout_part(self.world.make_randomized_env(skill, parameters, sensors), part))
        return Trajectories.join(recordings)

    def _replan(
        self, replanner: Replanner, schedule: EpisodeSchedule, target: TargetRobots, on_episode: OnEpisode
    ) -> Trajectories:
        steps, recordings = replanner.problem.steps(replanner.recipe.transfer.replan_seconds), []
        env = self.world.make_env(1, delay="latency" in target.parameters)
        for episode, waypoints in enumerate(schedule.waypoints):
            on_episode(episode, schedule.episodes)
            one = {name: values[episode : episode + 1] for name, values in target.parameters.items()}
            randomize_and_reset(env, np.full(1, NO_SKILL), one, generator(self.seed, f"sensors {target.name} {episode}"))
            recordings.append(replanner.episode(env, waypoints, steps * len(waypoints), self.seed))
        return Trajectories.join(recordings)
