"""Recipe section of the push task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import model_validator

from skillcli.config.base import Vector3, optional_value, value
from skillcli.simulation.settings import MAX_SKILLS, ArmTask


class PushTask(ArmTask):
    """The arm's finger pushes a box over the table; one skill per displacement."""

    name: Literal["push"] = value("push", "which task", "")
    goals: tuple[tuple[float, float], ...] = value(
        ((0.15, 0), (-0.15, 0), (0, 0.15), (0, -0.15)),
        "where the box of each skill should end, as seen from its nominal start", "m", min_length=1,
        max_length=MAX_SKILLS,
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
    def _box_fits(self) -> PushTask:
        if any(not 0.01 <= edge <= 0.3 for edge in self.box_size):
            raise ValueError("every edge of the box must measure between 0.01 and 0.3 m")
        return self
