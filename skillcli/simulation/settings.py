"""Recipe sections shared by the tasks: goals with one skill each, and the drive of an arm."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from pydantic import model_validator

from skillcli.config.base import Joints, Section, optional_value, value

MAX_SKILLS = 1000  # every pair of skills is computed


class TaskSettings(Section):
    """Settings of every task: goals, one skill each, their names, a clock, and the success radius."""

    SCENE: ClassVar[tuple[str, ...]] = ()
    """Keys that say what else is there: a plan may change them, since skills do not see it."""
    JUDGED: ClassVar[tuple[str, ...]] = ("tolerance",)
    """Keys that say how episodes are judged: a plan and its evaluation may change them."""

    module: str = optional_value("", "a Python file that holds the task, beside the recipe; empty for one that comes along")
    source_sha256: str = optional_value("", "of that file, filled in")
    name: str = value(..., "which task", "")
    goals: tuple[Any, ...]
    names: tuple[str, ...]
    tolerance: float = value(0.05, "success radius", "m", gt=0)
    horizon: int = value(64, "control steps in an episode", "steps", ge=2, le=10_000)
    control_period: float = value(0.05, "time between two commands", "s", ge=1e-3, le=1)

    @model_validator(mode="after")
    def _one_name_each(self) -> TaskSettings:
        if len(set(self.goals)) != len(self.goals):
            raise ValueError("two skills have the same goal")
        if self.names and (len(self.names) != len(self.goals) or len(set(self.names)) != len(self.names)):
            raise ValueError(f"{len(self.goals)} goals need as many different names, got {list(self.names)}")
        if any(not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+=-]{0,31}", name) for name in self.names):
            raise ValueError("names start with a letter or digit and hold letters, digits and _ . + = -")
        return self

    @property
    def action_scale(self) -> float:
        """Size of an action of one, in the unit of the action: rad for an arm."""
        raise NotImplementedError

    @property
    def one_by_one(self) -> bool:
        """Whether each waypoint of a plan is about another object, and is planned for from where the last one was met."""
        return False

    @property
    def mixing(self) -> tuple[int, ...]:
        """Indices of the skills whose goals can be mixed: those that do the same with another goal. By default all."""
        return tuple(range(len(self.goals)))


class ArmTask(TaskSettings):
    """Settings of every arm task: the start of an episode, and how the arm is driven."""

    start: Joints = value((), "joint vector at reset; by default where the robot's file has it for this task", "rad")
    action_limit: float = value(0.04, "largest joint increment per control step", "rad", gt=0, le=0.2)
    timestep: float = value(0.005, "time step of the physics", "s", ge=1e-4, le=0.02)
    observe_command: bool = value(
        False, "the policy also sees how far its commanded joint target leads the measured joints: what is still under way"
    )

    @model_validator(mode="after")
    def _whole_substeps(self) -> ArmTask:
        substeps = self.control_period / self.timestep
        if abs(substeps - round(substeps)) > 1e-6 or round(substeps) < 1:
            raise ValueError(f"control_period {self.control_period} must be a whole number of timesteps {self.timestep}")
        return self

    @property
    def action_scale(self) -> float:
        """Largest joint increment per control step, rad."""
        return self.action_limit
