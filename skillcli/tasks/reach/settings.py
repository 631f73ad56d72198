"""Recipe section of the reach task."""

from __future__ import annotations

from typing import Literal

from skillcli.config.base import Vector3, value
from skillcli.simulation.settings import MAX_SKILLS, ArmTask


class ReachTask(ArmTask):
    """The arm's gripper goes to a point in space; one skill per goal."""

    name: Literal["reach"] = value("reach", "which task", "")
    goals: tuple[Vector3, ...] = value(
        (
            (0.5, 0.3, 0.15), (0.5, -0.3, 0.15), (0.5, 0.3, 0.3), (0.5, -0.3, 0.3),
            (0.7, 0.3, 0.15), (0.7, -0.3, 0.15), (0.7, 0.3, 0.3), (0.7, -0.3, 0.3),
        ),
        "where the gripper of each skill should end, in the frame of the base", "m", min_length=1,
        max_length=MAX_SKILLS,
    )  # fmt: skip
    names: tuple[str, ...] = value((), "names of the skills; numbers from 1 where there are none", "")
