"""What is asked of a composition: waypoints on one or several routes, and for plans by hand the plan itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skillcli import metrics
from skillcli.composition import interpolation, sequence
from skillcli.composition.sequence import Entry
from skillcli.errors import UsageError
from skillcli.evaluation.library import skill_names
from skillcli.recipe import Recipe
from skillcli.tasks.registry import find_task
from skillcli.tasks.world import INTERPOLATED_SETS, World, skill_goals
from skillcli.trajectories import Array

Goals = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Request:
    """What is asked of a composition: a named task, goals in order, or a plan by hand.

    A task has one or several routes, each planned and executed from the start, with waypoints to be met in order.
    """

    task: str  # "" where goals are given
    routes: tuple[Array, ...]  # (W, 3) m each
    entries: tuple[tuple[Entry, ...], ...] = ()  # of each route, for a method that plays plans written by hand

    @staticmethod
    def of(recipe: Recipe, task: str, goals: Goals, method: str = "search") -> Request:
        """Named task or goals, as they fit the method; where neither is given, what the recipe asks for.

        Raises:
            UsageError: both, none, an unknown name, or a goal that cannot be reached.
        """
        if task and goals:
            raise UsageError("a composition takes --task or --goal, not both", "leave one of them out")
        if method == "interpolate":
            return _interpolated(recipe, task, goals)
        if method == "sequence":
            return _by_hand(recipe, task, goals)
        if not task and not goals:
            task, goals = recipe.compose.task, recipe.compose.goals
        if not task and not goals:
            raise UsageError("nothing to compose: neither --task nor --goal is given", "see `skill tasks`, or give --goal")
        if task in (*find_task(recipe.task.name).chains, *INTERPOLATED_SETS):
            raise UsageError(f"{task!r} goes through skills, not to goals", f"use --method interpolate --task {task}")
        return Request(task, _routes(recipe, task, goals))

    @property
    def waypoints(self) -> Array:
        """The waypoints of all routes, (W, 3) m."""
        return np.concatenate(self.routes)

    @property
    def route(self) -> Array:
        """The route that each of them belongs to, (W,)."""
        return np.repeat(np.arange(len(self.routes)), [len(route) for route in self.routes])


def _routes(recipe: Recipe, task: str, goals: Goals) -> tuple[Array, ...]:
    world = World.of(recipe)
    routes = world.named_routes(task) if task else (np.array([world.place_goal(goal) for goal in goals]),)
    for goal in np.concatenate(routes):
        world.check_goal(goal)
    return routes


def _by_hand(recipe: Recipe, task: str, goals: Goals) -> Request:
    """A plan by hand, judged by task or goals where they are given, else by the goals of the skills that it holds."""
    if not recipe.sequence.plan.strip():
        raise UsageError("the plan is empty: --method sequence needs --plan", "for example --plan 3,4,8,7")
    entries = tuple(sequence.parse(recipe.sequence.plan, skill_names(recipe), recipe.sequence.seconds))
    asked = _routes(recipe, task, goals) if task or goals else ()
    if len(asked) > 1:
        raise UsageError(f"task {task!r} has {len(asked)} routes, a plan by hand has one", "give --goal instead")
    routes = asked or (np.array(sequence.waypoints(entries, skill_goals(recipe.task))),)
    return Request(task, routes, (entries,))


def _interpolated(recipe: Recipe, task: str, goals: Goals) -> Request:
    """Chains through skills, one route each; the goals of the skills are the waypoints."""
    if goals:
        raise UsageError("--method interpolate goes through skills, not to goals", "give --skills or --task, or another method")
    settings, names, places = recipe.interpolate, skill_names(recipe), skill_goals(recipe.task)
    known = find_task(recipe.task.name).chains
    if not task and not settings.skills:
        task = next(iter(known), "neighbours")
    chains = _pairs(task, places) if task in INTERPOLATED_SETS else [_chain(recipe, task or settings.skills, known)]
    entries = [interpolation.chain(chain, names, settings.hold, settings.blend) for chain in chains]
    return Request(task, tuple(places[list(chain)] for chain in chains), tuple(tuple(entry) for entry in entries))


def _pairs(task: str, places: Array) -> list[tuple[int, int]]:
    pairs = interpolation.all_pairs(len(places)) if task == "pairs" else metrics.neighbours(places)
    if not pairs:
        raise UsageError("there is nothing to interpolate between", "it takes two skills at least")
    return pairs


def _chain(recipe: Recipe, task: str, known: Mapping[str, str]) -> list[int]:
    text = known.get(task, "" if task and task != recipe.interpolate.skills else task)
    if not text:
        raise UsageError(
            f"no interpolation {task!r} for the {recipe.task.name} task",
            f"interpolations: {', '.join((*known, *INTERPOLATED_SETS))}; or give --skills, such as 3,4,8,7",
        )
    names = skill_names(recipe)
    chain = [sequence.skill_index(word, names) for word in text.replace(",", " ").split()]
    if len(chain) < 2:
        raise UsageError(f"nothing to interpolate between in {text!r}", "it takes two skills at least, such as 3,4,8,7")
    return chain
