"""What a way to compose is: one `MethodSpec`, from what it takes on the command line to the plan that it makes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skillcli.composition.problem import MethodSettings, PlanningProblem, PlanResult
from skillcli.trajectories import Array

if TYPE_CHECKING:
    from skillcli.composition.sequence import Entry

__all__ = [
    "Finding",
    "MethodSettings",
    "MethodSpec",
    "Option",
    "PlanResult",
    "PlanningProblem",
    "WrittenRequest",
    "WrittenRoute",
]


@dataclass(frozen=True)
class Option:
    """An option of the command line that belongs to one method: it sets the recipe key of its name."""

    name: str
    help: str
    metavar: str
    type: type = str  # or int, or float
    read: Callable[[Any], Any] = lambda given: given  # what the key is set to; raises UsageError
    overrides: Callable[[Any], Sequence[str]] | None = None  # sets these KEY=VALUE instead; raises UsageError


@dataclass(frozen=True)
class WrittenRequest:
    """What is asked of a method that writes its plans down instead of searching for them; K skills."""

    settings: MethodSettings
    task: str  # a named task, "" where there is none
    goals: Sequence[Sequence[float]]  # as they are typed, none where none are given
    names: tuple[str, ...]  # of the skills
    places: Array  # (K, 3) m, where the skills lead
    task_name: str  # of the task that the skills are for
    chains: Mapping[str, str]  # named chains through its skills, such as "3,4,8,7"
    routes: Callable[[], tuple[Array, ...]]  # waypoints (W, 3) m of each route of the task or goals; raises UsageError


@dataclass(frozen=True)
class WrittenRoute:
    """A plan that is written down, and where it should lead."""

    entries: tuple[Entry, ...]
    waypoints: Array  # (W, 3) m


@dataclass(frozen=True)
class Finding:
    """What a method finds out about the skills beside its plans."""

    arrays: dict[str, Array]  # as the store keeps them
    results: dict[str, Any]  # fields of `ComposeResults`
    simulated_robot_seconds: float


@dataclass(frozen=True)
class MethodSpec:
    """One way to compose.

    Attributes:
        name: on the command line, and of its section in a recipe.
        settings: that section; its defaults are those of a recipe that does not mention it.
        plan: plans one route. It imports what takes long, torch above all, only when it is called.
        hint: what to try where a plan misses a waypoint.
        options: of the command line that are its own.
        draws: whether it draws at random, so that its plan depends on a seed.
        ensemble: whether it can try a latent on several robots at once.
        on_target: whether it can plan on one robot drawn from a target domain.
        replans: whether its plan can be made again on the way.
        learns: whether it trains a composer, whose weights and learning curves are kept.
        write: writes plans down, of the goals of skills or of what is typed; None for a method that needs goals.
        examine: what it finds out about the skills beside its plans, None for nothing.
        overrides_on_target: KEY=VALUE that hold where it plans on a target, unless others are given.
    """

    name: str
    settings: type[MethodSettings]
    plan: Callable[[PlanningProblem], PlanResult]
    hint: str
    options: tuple[Option, ...] = ()
    draws: bool = False
    ensemble: bool = False
    on_target: bool = False
    replans: bool = False
    learns: bool = False
    write: Callable[[WrittenRequest], list[WrittenRoute]] | None = None
    examine: Callable[[PlanningProblem], Finding] | None = None
    overrides_on_target: tuple[str, ...] = field(default=())

    @property
    def shared_options(self) -> tuple[str, ...]:
        """Names of the options that it shares with other methods; a seed draws robots too."""
        takes = {"ensemble": self.ensemble, "on": self.on_target, "seed": self.draws or self.ensemble or self.on_target}
        return tuple(name for name, taken in takes.items() if taken)

    @property
    def option_names(self) -> tuple[str, ...]:
        """Names of all options that it takes."""
        return (*(option.name for option in self.options), *self.shared_options)

    def overrides(self, given: Mapping[str, Any]) -> list[str]:
        """Its own options as recipe settings, `ddpg.iterations=50` say; what is None was not given.

        Raises:
            UsageError: an option has a value that cannot be meant.
        """
        found: list[str] = []
        for option in self.options:
            value = given.get(option.name)
            if value is not None and option.overrides is not None:
                found += option.overrides(value)
            elif value is not None:
                found.append(f"{self.name}.{option.name}={json.dumps(option.read(value))}")
        return found
