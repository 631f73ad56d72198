"""The request of a composition: waypoints on one or several routes, and for written plans the plan itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillcli.composition import interpolation
from skillcli.composition.method import WrittenRequest
from skillcli.composition.registry import DEFAULT, method_spec
from skillcli.composition.sequence import Entry
from skillcli.errors import UsageError
from skillcli.evaluation.library import skill_names
from skillcli.recipe import Recipe
from skillcli.tasks.registry import find_task
from skillcli.tasks.world import World, skill_goals
from skillcli.trajectories import Array

Goals = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Request:
    """A request: a named composition, goals in order, or a written plan.

    A composition has one or several routes. Each route starts at the start and has waypoints to meet in order.
    """

    task: str  # "" if goals are given
    routes: tuple[Array, ...]  # (W, 3) m each
    entries: tuple[tuple[Entry, ...], ...] = ()  # of each route, for a written plan

    @staticmethod
    def of(recipe: Recipe, task: str, goals: Goals, method: str = DEFAULT) -> Request:
        """Read the request from a task name or goals, as the method needs them; without both, from the recipe.

        Raises:
            UsageError: both are given, none is given, the name is unknown, or a goal cannot be reached.
        """
        if task and goals:
            raise UsageError("a composition takes --task or --goal, not both", "leave one of them out")
        write = method_spec(method).write
        if write is not None:
            routes = write(_written_request(recipe, method, task, goals))
            return Request(task, tuple(route.waypoints for route in routes), tuple(route.entries for route in routes))
        if not task and not goals:
            task, goals = recipe.compose.task, recipe.compose.goals
        if not task and not goals:
            raise UsageError("nothing to compose: neither --task nor --goal is given", "see `skill tasks`, or give --goal")
        if task in (*find_task(recipe.task.name).chains, *interpolation.SETS):
            how = f"use --method {interpolation.METHOD.name} --task {task}"
            raise UsageError(f"{task!r} goes through skills, not to goals", how)
        return Request(task, _routes(recipe, task, goals))

    @property
    def waypoints(self) -> Array:
        """Return the waypoints of all routes, (W, 3) m."""
        return np.concatenate(self.routes)

    @property
    def route(self) -> Array:
        """Return the route of each waypoint, (W,)."""
        return np.repeat(np.arange(len(self.routes)), [len(route) for route in self.routes])


def in_its_scene(recipe: Recipe, task: str, goals: Goals) -> Recipe:
    """Return the recipe with what the scene of a named composition has; without task and goals that of the recipe's own."""
    name = task or ("" if goals else recipe.compose.task)
    scene = find_task(recipe.task.name).scenes.get(name)
    return recipe if scene is None else recipe.in_scene(recipe.task.model_copy(update=scene))


def _routes(recipe: Recipe, task: str, goals: Goals) -> tuple[Array, ...]:
    world = World.of(recipe)
    routes = world.named_routes(task) if task else (np.array([world.place_goal(goal) for goal in goals]),)
    for goal in np.concatenate(routes):
        world.check_goal(goal)
    return routes


def _written_request(recipe: Recipe, method: str, task: str, goals: Goals) -> WrittenRequest:
    return WrittenRequest(
        settings=recipe.settings_of(method),
        task=task,
        goals=goals,
        names=skill_names(recipe),
        places=skill_goals(recipe.task),
        task_name=recipe.task.name,
        chains=find_task(recipe.task.name).chains,
        routes=lambda: _routes(recipe, task, goals),
    )
