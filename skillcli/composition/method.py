"""`MethodSpec`: everything about one method of composition, from its command line options to its planner."""

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
    """A command line option of one method. It sets the recipe key of the same name."""

    name: str
    help: str
    metavar: str
    type: type = str  # or int, or float
    read: Callable[[Any], Any] = lambda given: given  # converts to the value of the key; raises UsageError
    stored: str = ""  # kind of artifact whose id is taken too, for the plan that was played in it; "" for none
    overrides: Callable[[Any], Sequence[str]] | None = None  # returns KEY=VALUE settings to use instead; raises UsageError


@dataclass(frozen=True)
class WrittenRequest:
    """The request to a method that writes plans instead of searching for them; K skills."""

    settings: MethodSettings
    task: str  # name of a composition, or ""
    goals: Sequence[Sequence[float]]  # goals as typed; may be empty
    names: tuple[str, ...]  # names of the skills
    places: Array  # (K, 3) m, goals of the skills
    task_name: str  # task of the skills
    chains: Mapping[str, str]  # named chains of skills, such as "3,4,8,7"
    routes: Callable[[], tuple[Array, ...]]  # returns waypoints (W, 3) m of each route; raises UsageError


@dataclass(frozen=True)
class WrittenRoute:
    """A written plan and the waypoints that it should meet."""

    entries: tuple[Entry, ...]
    waypoints: Array  # (W, 3) m


@dataclass(frozen=True)
class Finding:
    """What a method measures about the skills, in addition to its plans."""

    arrays: dict[str, Array]  # as the store keeps them
    results: dict[str, Any]  # fields of `ComposeResults`
    simulated_robot_seconds: float


@dataclass(frozen=True)
class MethodSpec:
    """One method of composition.

    Attributes:
        name: of the method on the command line, and of its section in a recipe.
        settings: type of that section; its defaults apply to a recipe without the section.
        plan: plans one route. It imports slow packages such as torch only when called.
        hint: what to try if a plan misses a waypoint.
        options: command line options of this method alone.
        draws: whether it is random, so that its plan depends on a seed.
        ensemble: whether it can try a latent on several robots at once.
        on_target: whether it can plan on one robot drawn from a target domain.
        replans: whether it can plan again during an episode.
        learns: whether it trains a composer, whose weights and learning curves are stored.
        write: writes plans from the goals of skills or from typed text; None for a method that needs goals.
        examine: measures something about the skills in addition to the plans; None for nothing.
        overrides_on_target: KEY=VALUE settings for planning on a target, unless the user gives others.
        argument: the option that `--method NAME:VALUE` sets; "" for none.
        hands_over_to: the method that plans instead where this one cannot; "" for none.
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
    argument: str = ""
    hands_over_to: str = ""

    @property
    def sections(self) -> tuple[str, ...]:
        """Sections of a recipe that its plans depend on."""
        return (self.name, self.hands_over_to) if self.hands_over_to else (self.name,)

    @property
    def shared_options(self) -> tuple[str, ...]:
        """Names of the options shared with other methods; an ensemble needs a seed too."""
        takes = {"ensemble": self.ensemble, "on": self.on_target, "seed": self.draws or self.ensemble or self.on_target}
        return tuple(name for name, taken in takes.items() if taken)

    @property
    def option_names(self) -> tuple[str, ...]:
        """Names of all its options."""
        return (*(option.name for option in self.options), *self.shared_options)

    def overrides(self, given: Mapping[str, Any]) -> list[str]:
        """Convert its own options to recipe settings such as `ddpg.iterations=50`; None means not given.

        Raises:
            UsageError: an option has an invalid value.
        """
        found: list[str] = []
        for option in self.options:
            value = given.get(option.name)
            if value is not None and option.overrides is not None:
                found += option.overrides(value)
            elif value is not None:
                found.append(f"{self.name}.{option.name}={json.dumps(option.read(value))}")
        return found
