"""`SkillLibrary`: trained skills as a program uses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skillcli.api import given
from skillcli.api.plan import ComposedPlan
from skillcli.errors import UsageError
from skillcli.progress import OnProgress, silent
from skillcli.trajectories import Array, Trajectories

if TYPE_CHECKING:
    from skillcli.evaluation.episode_schedule import EpisodeSchedule
    from skillcli.evaluation.library import Library
    from skillcli.recipe import Recipe
    from skillcli.store import Artifact, Store
    from skillcli.tasks.world import World

Goal = str | Sequence[float] | Sequence[Sequence[float]] | Array


@dataclass(frozen=True, eq=False)
class Skill:
    """One trained skill.

    Attributes:
        name: as in the recipe; a number from 1 where the recipe names none.
        goal: (3,) m, where it was trained to end, in the frame of the robot's base.
        mean: (d,) mean of its distribution p(z|t) over latents.
        std: (d,) standard deviation of that distribution.
    """

    name: str
    goal: Array
    mean: Array
    std: Array


@dataclass(frozen=True, eq=False)
class SkillLibrary:
    """K frozen skills with latents of size d: one policy that is conditioned on a latent, and where each skill lies.

    Made by `skillcli.load` and `skillcli.train`. It reads from its store and writes nothing.

    Attributes:
        store: that it was read from.
        artifact: that holds it, or was made from it.
    """

    store: Store
    artifact: Artifact

    def __repr__(self) -> str:
        """Name it and say what it holds."""
        return f"SkillLibrary({self.id!r}, {len(self.skills)} skills of the {self.recipe.task.name} task)"

    @property
    def id(self) -> str:
        """Return the id of the artifact, such as "reach/embed-means-v1"."""
        return str(self.artifact.id)

    @property
    def recipe(self) -> Recipe:
        """Return everything that determined the training."""
        return self._library.recipe

    @cached_property
    def skills(self) -> tuple[Skill, ...]:
        """Return the K skills in the order of the recipe."""
        library = self._library
        return tuple(map(Skill, library.names, library.goals, library.mean, library.std))

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the arm's joints in order; empty for a task without an arm."""
        world = self._library.world
        return tuple(world.robot.description.joints) if world.spec.uses_robot else ()

    @property
    def observation(self) -> dict[str, tuple[int, str]]:
        """Return size and unit of each term of an observation, by name and in order; together they have size o."""
        return {term.name: (term.size, term.unit) for term in self._library.world.observation_terms}

    @property
    def control_period(self) -> float:
        """Return the time between two actions, s."""
        return float(self.recipe.task.control_period)

    @property
    def action_scale(self) -> float:
        """Return what an action of one means: rad of joint increment, or m for the point task."""
        return float(self.recipe.task.action_scale)

    def embed(self, skill: str | int | None = None) -> tuple[Array, Array]:
        """Return the distribution p(z|t) of skills over latents.

        Args:
            skill: its name or index; None for all.

        Returns:
            Means and standard deviations, (K, d) each, or (d,) each for one skill.

        Raises:
            UsageError: there is no such skill.
        """
        library = self._library
        if skill is None:
            return library.mean.copy(), library.std.copy()
        k = given.skill_index(skill, library.names)
        return library.mean[k].copy(), library.std[k].copy()

    def act(self, observation: Array, latent: Array) -> Array:
        """Compute the policy's mean action.

        Args:
            observation: (N, o) or (o,), as `observation` describes it.
            latent: (N, d) or (d,); one latent may serve N observations.

        Returns:
            (N, a) or (a,), in units of `action_scale`; an environment clips it to ±1.

        Raises:
            UsageError: a shape does not fit, or a number is not finite.
        """
        seen = given.numbers(observation, "observation", sum(size for size, _ in self.observation.values()))
        held = given.numbers(latent, "latent", self._library.mean.shape[1])
        rows = np.atleast_2d(seen)
        try:
            latents = np.broadcast_to(held, (len(rows), held.shape[-1]))
        except ValueError:
            raise UsageError(
                f"got {len(rows)} observations and {len(held)} latents", "give one latent for all, or one each"
            ) from None
        action: Array = self._library.agent.act(rows, np.array(latents))
        return action[0] if seen.ndim == 1 else action

    def rollout(
        self,
        what: ComposedPlan | str | Array | Sequence[float],
        *,
        goal: Sequence[float] | None = None,
        robot: str | Path | None = None,
        domain: str | None = None,
        episodes: int | None = None,
        seed: int = 0,
    ) -> Trajectories:
        """Simulate episodes with actions without noise, from the start.

        Args:
            what: a plan of this library; or a latent (d,), or latents (E, d), each held for a whole episode; or the name of a
                skill, whose mean latent is held.
            goal: where latents should end, as `skill compose --goal` takes it; by default the goal of the skill that most
                likely has the latent. It only decides about success and reward.
            robot: a bundled robot, or a robot file, to run on instead of the library's own; another model of the same arm.
            domain: a preset or a TOML file; every episode is on a robot drawn from it. By default the nominal robot.
            episodes: E; latents, or the routes of a plan, take turns. By default one of each.
            seed: of the robots drawn and their sensors.

        Returns:
            E recorded episodes. Success: the end is within the task's tolerance of the goal, and every waypoint of a plan
            was met in order.

        Raises:
            UsageError: the plan is another library's, a shape does not fit, or robot or domain are unknown.
        """
        from skillcli.evaluation.transfer_evaluator import NOMINAL, TargetRobots, TransferEvaluator
        from skillcli.simulation.domains import find_domain

        schedule = self._schedule(what, goal)
        count = schedule.episodes if episodes is None else given.at_least_one(episodes, "episodes")
        world = self._on(robot)
        target = TargetRobots.drawn(find_domain(domain), count, seed, world.joints) if domain else NOMINAL
        return TransferEvaluator(self._library, seed, world).run(schedule.in_turn(count), target)

    def plan(
        self,
        goal: Goal = (),
        method: str = "search",
        *,
        settings: Sequence[str] = (),
        seed: int = 0,
        on: str = "",
        on_progress: OnProgress = silent,
    ) -> ComposedPlan:
        """Compose the skills into a task that was never trained; nothing is stored until `ComposedPlan.save`.

        Args:
            goal: one goal, as `skill compose --goal` takes it: for reach x, y, z of the gripper in the frame of the base, m;
                for push the displacement of the box, m. Or several in order, or the name of a composition such as "triangle".
            method: a name of `skill compose --method`.
            settings: KEY=VALUE settings of planning, such as "search.weight=10".
            seed: of random methods.
            on: a domain; plans on one robot drawn from it.
            on_progress: called with the progress of planning.

        Returns:
            The plan and what happened when it was executed where it was planned.

        Raises:
            UsageError: the goal cannot be reached, or method, settings or domain are unknown.
        """
        from skillcli.composition.registry import method_spec, split_method
        from skillcli.evaluation.consistency import stored_recipe
        from skillcli.evaluation.request import Request, in_its_scene
        from skillcli.stages.compose import draft_of

        task, goals = given.goals(goal)
        name, own = split_method(method)
        spec = method_spec(name)
        chosen = [*(spec.overrides_on_target if on else ()), *settings, *spec.overrides(own)]
        recipe = in_its_scene(stored_recipe(self.artifact, chosen), task, goals)
        request = Request.of(recipe, task, goals, name)
        command = given.call("skillcli.load", self.id) + given.call(
            ".plan", task or goals, method, settings=[*settings], seed=seed, on=on
        )
        draft = draft_of(
            self._library, self.artifact, recipe, request, name, command, on_progress=on_progress, seed=seed, on=on
        )
        return ComposedPlan(self.store, self.artifact.id, draft)

    @cached_property
    def _library(self) -> Library:
        from skillcli.evaluation.library import open_library

        return open_library(self.store, self.artifact)

    def _on(self, robot: str | Path | None) -> World:
        world = self._library.world
        if robot is None:
            return world
        from skillcli.robots.robot import load_target

        return world.on(load_target(robot, world.robot))

    def _schedule(self, what: Any, goal: Sequence[float] | None) -> EpisodeSchedule:
        from skillcli import metrics
        from skillcli.evaluation.episode_schedule import EpisodeSchedule

        library = self._library
        if isinstance(what, ComposedPlan):
            if what.source != self.artifact.id or what.store.root != self.store.root:
                raise UsageError(
                    f"this plan was made with {what.source}, not with {self.id}", "roll it out with its own library"
                )
            return what.schedule
        named = given.skill_index(what, library.names) if isinstance(what, str) else None
        latent = np.atleast_2d(
            library.mean[named] if named is not None else given.numbers(what, "latent", library.mean.shape[1])
        )
        likely = metrics.most_likely_skill(latent, library.mean, library.std)
        places = library.goals[likely if named is None else [named]]
        if goal is not None:
            places = np.tile(library.world.place_goal([float(x) for x in goal]), (len(latent), 1))
        is_mean = (latent == library.mean[likely]).all(axis=1)
        horizon = library.recipe.task.horizon
        return EpisodeSchedule(
            np.repeat(latent[:, None], horizon, axis=1),
            np.repeat(np.where(is_mean, likely, -1)[:, None], horizon, axis=1),
            np.full(len(latent), horizon),
            tuple(place[None] for place in places),
        )
