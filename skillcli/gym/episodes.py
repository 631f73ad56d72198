"""What both kinds of environments do N times side by side: episodes of a task, or of the composer's problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium import spaces

from skillcli.errors import UsageError
from skillcli.hull import Hull
from skillcli.tasks.world import World
from skillcli.trajectories import Array

# The engine ends an episode as unstable beyond 100 rad or 100 m; a difference of two such numbers is at most this.
LARGEST = 200.0

Observations = Array | dict[str, Array]


class Played(NamedTuple):
    """What one step of N episodes led to."""

    reward: Array  # (N,)
    terminated: Array  # (N,) bool
    truncated: Array  # (N,) bool: out of time
    distance: Array  # (N,) m, of the achieved goal to the desired one
    success: Array  # (N,) bool: that distance is within the tolerance


class Episodes(Protocol):
    """N episodes, each with a goal of its own."""

    num_envs: int
    world: World
    control_period: float  # s, between two steps
    goals: GoalChoice
    observation_space: spaces.Space[Any]  # of one episode
    action_space: spaces.Box

    def begin(self, ids: Array, goals: Array) -> None:
        """Put these episodes (n,) at the start, with goals (n, 3) m."""

    def observe(self) -> Observations:
        """Return the observations of all episodes, in memory of their own."""

    def step(self, action: Array, running: Array | None) -> Played:
        """Apply actions (N, a) to these episodes (n,), None for all; the others' results mean nothing."""


class GoalChoice:
    """The goals of episodes: drawn uniformly from the hull of the trained goals, or as a user gives them."""

    def __init__(self, world: World) -> None:
        self._world, self._hull = world, Hull(world.goals)

    def draw(self, rng: np.random.Generator) -> Array:
        """Draw a goal, (3,) m."""
        goal: Array = self._hull.draw(1, rng)[0]
        return goal

    def given(self, options: dict[str, Any] | None) -> Array | None:
        """Return the goal (3,) m that the options of a reset name; None if they name none.

        Raises:
            UsageError: there is an unknown option, or the goal cannot be reached.
        """
        unknown = sorted((options or {}).keys() - {"goal", "skill"})
        if unknown:
            raise UsageError(f"reset: no option {unknown[0]!r}", "options: goal, as it is typed; skill, an index")
        if not options:
            return None
        if "skill" in options:
            skill = options["skill"]
            if "goal" in options or not 0 <= skill < len(self._world.goals):
                raise UsageError(
                    f"reset: expected one goal, or a skill from 0 to {len(self._world.goals) - 1}", f"got {options}"
                )
            chosen: Array = self._world.goals[skill]
            return chosen
        return self.place([float(x) for x in options["goal"]])

    def place(self, goal: Sequence[float]) -> Array:
        """Convert a typed goal to its place, (3,) m.

        Raises:
            UsageError: it cannot be reached.
        """
        place = np.array(self._world.place_goal(goal))
        self._world.check_goal(place)
        return place


def finite_actions(action: Array, shape: tuple[int, ...]) -> Array:
    """Return actions of this shape as numbers.

    Raises:
        UsageError: the shape is another one, or a number is not finite.
    """
    found: Array = np.asarray(action, dtype=np.float64)
    if found.shape != shape:
        raise UsageError(f"action: expected the shape {shape}, got {found.shape}", "see `action_space`")
    if not np.isfinite(found).all():
        raise UsageError("action: a number is not finite", "give numbers from -1 to 1")
    return found


def box(size: int, largest: float = LARGEST, dtype: Any = np.float32) -> spaces.Box:
    """Return a box of `size` numbers within ±`largest`."""
    return spaces.Box(-largest, largest, (size,), dtype)
