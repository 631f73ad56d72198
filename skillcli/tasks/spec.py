"""A task as a value: what it is for, its settings, its environment, its goals, and what planners and pictures need of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco

from skillcli.robots.robot import Robot
from skillcli.simulation.environment import Array, Environment, ObservationTerm
from skillcli.simulation.settings import TaskSettings

# Routes from the start, each of waypoints in order: goals as they are typed.
Route = tuple[tuple[float, ...], ...]


class TaskEnvironment(Protocol):
    """What the class of a task's environment offers beside its simulations."""

    privileged_terms: tuple[ObservationTerm, ...]
    recorded: Mapping[str, int]  # fields of a recording beside the joints, and how many numbers each has

    def __call__(
        self, task: Any, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False
    ) -> Environment:
        """N simulations; see `ArmEnvironment`."""

    def observation_terms(self, task: Any, joints: int) -> tuple[ObservationTerm, ...]:
        """What the policy sees, in order, on an arm with this many joints."""

    def scene(self, task: Any, robot: Robot, delay: bool = False) -> mujoco.MjSpec | None:
        """The scene, None for a task that no engine simulates."""


def no_check(*_: Any) -> None:
    """Refuse nothing."""


def straight_distance(_: Any) -> None:
    """Nothing but the distance is left to go."""


@dataclass(frozen=True, eq=False)
class FigureSettings:
    """What to draw of a task, and how.

    Attributes:
        planes: pairs of axes that its space is drawn in, 0 x, 1 y, 2 z.
        achieved: what is judged, in a word.
        unit: of distances, and how many of it are a metre.
        latent_sigmas: standard deviations at which ellipses are drawn in the latent space.
        action_unit: of the norm of an action.
        goal_size: numbers of a goal as it is typed.
        goals_from_start: whether goals are typed as seen from where what is judged starts.
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
    """A task. A new one is a `TaskSpec` in a room of its own, or in a file of a user.

    Attributes:
        name: as recipes name it.
        description: in one line.
        settings: the recipe's section `task`.
        environment: gives the class of its environment; called when one is needed first, since engines are slow to import.
        place_goal: from a goal as it is typed to where it is, (3,) m.
        example: of a goal as it is typed.
        check_goal: refuses a goal (3,) m that cannot be reached whatever the skills, for settings, robot and goal.
        check_start: refuses starts that make no sense, for settings and how far off an object may start, from and to, m.
        compositions: named routes.
        chains: named chains through skills by number, for interpolation.
        cost_to_go: what planners count as left to go, for settings, see `composition.route.CostToGo`; None where the straight
            distance says it all.
        uses_robot: whether an arm is in it.
        placed: keys of the section `task` that `place` fills in.
        place: what a recipe leaves open of the section `task` on another robot than the one that the defaults lie around: from
            what it says of the section, and the robot. By default the robot's start alone.
        drawing: what to draw, and how.
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
    chains: Mapping[str, str] = field(default_factory=dict)
    uses_robot: bool = True
    placed: tuple[str, ...] = ()
    place: Callable[[Mapping[str, Any], Robot], dict[str, Any]] | None = None
    cost_to_go: Callable[[Any], Any] = straight_distance
    figure_settings: FigureSettings = field(default_factory=FigureSettings)
