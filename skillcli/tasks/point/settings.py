"""Recipe section of the point task."""

from __future__ import annotations

from typing import Literal

from skillcli.config.base import value
from skillcli.simulation.settings import MAX_SKILLS, TaskSettings


class PointTask(TaskSettings):
    """A point in the plane that is moved by velocity; one skill per goal."""

    name: Literal["point"] = value("point", "which task", "")
    goals: tuple[tuple[float, float], ...] = value(
        ((0, 3), (3, 0), (0, -3), (-3, 0)), "where each skill should end", "m", min_length=1, max_length=MAX_SKILLS
    )
    names: tuple[str, ...] = value((), "names of the skills; numbers from 1 where there are none", "")
    tolerance: float = value(0.1414, "success radius: the diagonal of one step", "m", gt=0)
    horizon: int = value(50, "control steps in an episode", "steps", ge=2, le=10_000)
    step_limit: float = value(0.1, "largest move per axis and control step", "m", gt=0)
    control_period: float = value(0.05, "time between two commands; nominal, the point has no physics", "s", ge=1e-3, le=1)
    bound: float = value(5.0, "positions are clipped to this on either axis", "m", gt=0)

    @property
    def action_scale(self) -> float:
        """Largest move per axis and control step, m."""
        return self.step_limit
