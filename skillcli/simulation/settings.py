"""Recipe sections that the tasks share: goals with one skill each, and an arm that is driven."""

from __future__ import annotations

import re
from typing import Any

from pydantic import model_validator

from skillcli.config.base import Joints, Section, value

MAX_SKILLS = 1000  # every pair of them is looked at


class SkillSet(Section):
    """What every task has: goals, one skill each, and their names."""

    goals: tuple[Any, ...]
    names: tuple[str, ...]

    @model_validator(mode="after")
    def _one_name_each(self) -> SkillSet:
        if len(set(self.goals)) != len(self.goals):
            raise ValueError("two skills have the same goal")
        if self.names and (len(self.names) != len(self.goals) or len(set(self.names)) != len(self.names)):
            raise ValueError(f"{len(self.goals)} goals need as many different names, got {list(self.names)}")
        if any(not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+=-]{0,31}", name) for name in self.names):
            raise ValueError("names start with a letter or digit and hold letters, digits and _ . + = -")
        return self


class ArmTask(SkillSet):
    """What every task of the Sawyer has: how an episode starts and how the arm is driven."""

    tolerance: float = value(0.05, "success radius", "m", gt=0)
    horizon: int = value(64, "control steps in an episode", "steps", ge=2, le=10_000)
    start: Joints = value(
        (-0.2791, -1.2418, 0.0126, 1.6544, -0.0044, 1.1583, 3.1016),
        "joint vector at reset: gripper at (.6, 0, .25), pointing down", "rad",
    )  # fmt: skip
    action_limit: float = value(0.04, "largest joint increment per control step", "rad", gt=0, le=0.2)
    control_period: float = value(0.05, "time between two commands", "s", ge=1e-3, le=1)
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
