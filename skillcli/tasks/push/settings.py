"""Recipe section of the push task."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from skillcli.config.base import Vector3, optional_value, value
from skillcli.simulation.settings import MAX_SKILLS, ArmTask

# m per rad: of a goal that names a turn, 10 degrees count as much as 3 cm, the pair by which pushes are judged in the field.
TURN = 0.03 / math.radians(10)
MOST_TURN = 2.0  # rad: farther, the way round the other side would be as short


class PushTask(ArmTask):
    """The arm's finger pushes a box over the table; one skill per displacement."""

    name: Literal["push"] = value("push", "which task", "")
    goals: tuple[Annotated[tuple[float, ...], Field(min_length=2, max_length=3)], ...] = value(
        ((0.15, 0), (-0.15, 0), (0, 0.15), (0, -0.15)),
        "where the box of each skill should end, as seen from its nominal start; a third number is how far it should be turned"
        " there, in rad, counter-clockwise as seen from above: 10 degrees count as much as 3 cm",
        "m", min_length=1, max_length=MAX_SKILLS,
    )  # fmt: skip
    names: tuple[str, ...] = value(
        ("up", "down", "left", "right"), "names of the skills; numbers from 1 where there are none", ""
    )
    horizon: int = value(80, "control steps in an episode", "steps", ge=2, le=10_000)
    timestep: float = value(
        0.0025, "time step of the physics, which contact needs finer than free motion", "s", ge=1e-4, le=0.02
    )
    box_start: tuple[float, float] = value((0.6, 0.0), "nominal start of the box on the table", "m")
    box_size: Vector3 = value((0.06, 0.06, 0.06), "full edges of the box", "m")
    box_mass: float = value(0.3, "of the box, evenly filled", "kg", gt=0, le=5)
    friction: float = value(0.6, "sliding friction between box and table, and box and finger", "", gt=0, le=3)
    observe_place: bool = value(
        False, "the policy also sees where on the table the box is, as joints and relative position together tell"
    )

    approach: float = optional_value(
        0.5, "weight in the reward of the way from the finger to the place behind the box", "1/m", gt=0, le=10
    )
    tipping: float = optional_value(
        0.01, "weight in the reward of the square of the speed at which the box tips", "s²/rad²", ge=0, le=10
    )
    upright: float = optional_value(
        0.0,
        "weight in the reward of a finger that leans by more than 30 degrees from straight down",
        "",
        ge=0,
        le=10,
    )

    @model_validator(mode="before")
    @classmethod
    def _other_goals_have_no_names(cls, given: Any) -> Any:
        """Drop the default names if the goals are not the default ones."""
        return {"names": (), **given} if isinstance(given, Mapping) and "goals" in given else given

    @model_validator(mode="after")
    def _goals_are_alike(self) -> PushTask:
        if len({len(goal) for goal in self.goals}) > 1:
            raise ValueError("goals name x and y, or x, y and a turn, all of them alike")
        if any(abs(goal[2]) > MOST_TURN for goal in self.goals if len(goal) == 3):
            raise ValueError(f"a box may be turned by up to {MOST_TURN:g} rad to either side")
        return self

    @property
    def turns(self) -> bool:
        """Whether goals name how far the box should be turned."""
        return len(self.goals[0]) == 3

    @model_validator(mode="after")
    def _box_fits(self) -> PushTask:
        if any(not 0.01 <= edge <= 0.3 for edge in self.box_size):
            raise ValueError("every edge of the box must measure between 0.01 and 0.3 m")
        return self
