"""`TaskSpec`: a task as a value, with settings, environment, goals, and what planners and figures need of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco

from skillcli.robots.config import DEFAULT_ROBOT
from skillcli.robots.robot import Robot
from skillcli.simulation.environment import Array, Environment, ObservationTerm
from skillcli.simulation.settings import TaskSettings

# Routes from the start, each with waypoints in order: goals as they are typed.
Route = tuple[tuple[float, ...], ...]


class TaskEnvironment(Protocol):
    """What the class of a task's environment offers besides its simulations."""

    privileged_terms: tuple[ObservationTerm, ...]
    recorded: Mapping[str, int]  # recorded fields besides the joints, and the size of each

    def __call__(
        self, task: Any, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False
    ) -> Environment:
        """Make N simulations; see `ArmEnvironment`."""

    def observation_terms(self, task: Any, joints: int) -> tuple[ObservationTerm, ...]:
        """Return the terms of the observation in order, on an arm with this many joints."""

    def scene(self, task: Any, robot: Robot, delay: bool = False) -> mujoco.MjSpec | None:
        """Build the scene; None if no engine simulates the task."""


def no_check(*_: Any) -> None:
    """Accept everything."""


def unchanged_route(_: Any, route: Route) -> Route:
    """Return the route."""
    return route


def itself(_: Any, waypoint: Array) -> tuple[Array, ...]:
    """Return the waypoint."""
    return (waypoint,)


def straight_distance(_: Any) -> None:
    """Return None: only the straight distance counts."""


@dataclass(frozen=True, eq=False)
class FigureSettings:
    """How figures show a task.

    Attributes:
        planes: pairs of axes of its maps, 0 x, 1 y, 2 z.
        achieved: the achieved goal, in a word.
        unit: of distances, and how many of it make a metre.
        latent_sigmas: standard deviations of the ellipses in the latent space.
        action_unit: of the norm of an action.
        goal_size: numbers of a goal as it is typed.
        goals_from_start: whether goals are typed relative to the start of the achieved goal.
    """

    planes: tuple[tuple[int, int], ...] = ((0, 1), (0, 2))
    achieved: str = "gripper"
    unit: tuple[str, float] = ("cm", 100.0)
    latent_sigmas: tuple[int, ...] = (1,)
    action_unit: str = "rad per step"
    goal_size: int = 3
    goals_from_start: bool = False


@dataclass(frozen=True, eq=False)
class TaskSpec:
    """A task. A new one is a `TaskSpec` in a folder of its own, or in a user's file.

    Attributes:
        name: as recipes name it.
        description: in one line.
        settings: type of the recipe's section `task`.
        environment: returns the class of its environment; called late, since engines are slow to import.
        place_goal: converts a typed goal to its place, (3,) m.
        example: of a typed goal.
        check_goal: refuses a goal (3,) m that no skill can reach, for settings, robot and goal.
        check_start: refuses invalid starts, for settings and how far an object may be moved, from and to, m.
        compositions: named routes.
        scenes: settings of the task that compositions of these names need besides their routes, see `TaskSettings.SCENE`.
        fit_route: a named route as it is typed for settings whose goals lie elsewhere than the task's own; by default as it is.
        chains: named chains of skills by number, for interpolation.
        cost_to_go: cost that planners use, for settings, see `composition.route.CostToGo`; returns None if the straight
            distance is enough.
        aims: places (3,) m whose latents help planners to a waypoint (3,) m, where mixtures make the latent space a map, for
            settings and the waypoint; by default the waypoint.
        uses_robot: whether an arm takes part.
        robot: a bundled arm that can do it, for whoever names neither a robot nor a recipe.
        grasps: whether the width between the fingers of its hand is one more action.
        placed: keys of the section `task` that `place` fills in.
        place: fills in open keys of the section `task` on another robot than the default one, from the settings and the
            robot; by default only the robot's start.
        figure_settings: how figures show it.
    """

    name: str
    description: str
    settings: type[TaskSettings]
    environment: Callable[[], TaskEnvironment]
    place_goal: Callable[[Any, Sequence[float]], list[float]]
    example: str
    check_goal: Callable[[Any, Robot, Array], None] = no_check
    check_start: Callable[[Any, float, float], None] = no_check
    compositions: Mapping[str, tuple[Route, ...]] = field(default_factory=dict)
    scenes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    fit_route: Callable[[Any, Route], Route] = unchanged_route
    chains: Mapping[str, str] = field(default_factory=dict)
    uses_robot: bool = True
    robot: str = DEFAULT_ROBOT
    grasps: bool = False
    placed: tuple[str, ...] = ()
    place: Callable[[Any, Robot], dict[str, Any]] | None = None
    cost_to_go: Callable[[Any], Any] = straight_distance
    aims: Callable[[Any, Array], tuple[Array, ...]] = itself
    figure_settings: FigureSettings = field(default_factory=FigureSettings)
