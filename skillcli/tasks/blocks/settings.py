"""Recipe section of the blocks task."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import model_validator

from skillcli.config.base import Vector3, optional_value, value
from skillcli.simulation.arms import MOST_OBJECTS
from skillcli.simulation.settings import MAX_SKILLS, ArmTask

KINDS = ("above", "lift", "carry", "place")  # what a skill does: the first word of its name


class BlocksTask(ArmTask):
    """The arm's hand grasps a block, carries it, and puts it down; one skill per goal."""

    SCENE: ClassVar[tuple[str, ...]] = ("others", "build")

    name: Literal["blocks"] = value("blocks", "which task", "")
    goals: tuple[Vector3, ...] = value(
        (
            (0.5, 0.0, 0.09), (0.5, 0.0, 0.15),
            (0.4, -0.15, 0.15), (0.4, 0.15, 0.15), (0.6, -0.15, 0.15), (0.6, 0.15, 0.15),
            (0.4, -0.15, 0.02), (0.4, 0.15, 0.02), (0.6, -0.15, 0.02), (0.6, 0.15, 0.02),
            (0.5, 0.0, 0.02),
        ),
        "where each skill should end: of `above` the gripper, of the others the middle of the block; x and y of above, lift and"
        " place as if the block began at block_start, and else as far from where it begins; of lift only the height counts",
        "m", min_length=1, max_length=MAX_SKILLS,
    )  # fmt: skip
    names: tuple[str, ...] = value(
        (
            "above", "lift",
            "carry-near-right", "carry-near-left", "carry-far-right", "carry-far-left",
            "carry-near-right-low", "carry-near-left-low", "carry-far-right-low", "carry-far-left-low",
            "place",
        ),
        "names of the skills; each begins with what it does: above, lift, carry or place", "", min_length=1,
    )  # fmt: skip
    tolerance: float = value(0.02, "success radius", "m", gt=0)
    horizon: int = value(60, "control steps in an episode", "steps", ge=2, le=10_000)
    timestep: float = value(
        0.0025, "time step of the physics, which contact needs finer than free motion", "s", ge=1e-4, le=0.02
    )
    block_start: tuple[float, float] = value((0.5, 0.0), "nominal start of the block on the table", "m")
    others: tuple[tuple[float, float], ...] = value(
        (),
        "starts of further blocks, up to two; some episodes of place begin with the block in the hand on the first",
        "m",
        max_length=MOST_OBJECTS - 1,
    )
    build: tuple[Vector3, ...] = optional_value(
        (), "of a plan for several blocks: where the first one goes, then those of `others`, one after the other", "m"
    )
    block_size: float = value(0.04, "edge of the block", "m", ge=0.01, le=0.3)
    block_mass: float = value(0.1, "of the block, evenly filled", "kg", gt=0, le=5)
    friction: float = value(0.6, "sliding friction between block and table", "", gt=0, le=3)
    pad_friction: float = value(1.0, "sliding friction of the fingers", "", gt=0, le=3)
    grip_force: float = value(20.0, "with which each finger of the closed hand presses", "N", gt=0, le=500)
    grasped_starts: bool = value(
        True,
        "episodes of lift begin above the block, those of carry and place with it in the hand, and not at the start",
    )

    @model_validator(mode="after")
    def _kinds_are_known(self) -> BlocksTask:
        if len(self.names) != len(self.goals):
            raise ValueError("every goal needs a name, which says what its skill does")
        unknown = [name for name in self.names if name.split("-")[0] not in KINDS]
        if unknown:
            raise ValueError(f"names begin with {', '.join(KINDS)}, got {unknown[0]!r}")
        return self

    @model_validator(mode="after")
    def _there_are_blocks_to_build_with(self) -> BlocksTask:
        if len(self.build) > len(self.others) + 1:
            raise ValueError(f"task.build places {len(self.build)} blocks, there are {len(self.others) + 1}")
        return self

    @property
    def one_by_one(self) -> bool:
        """See `TaskSettings`."""
        return bool(self.build)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return what each skill does, one of `KINDS`."""
        return tuple(name.split("-")[0] for name in self.names)

    @property
    def carry_height(self) -> float:
        """Return how high blocks are carried, their middles, m."""
        return max(goal[2] for goal in self.goals)

    @property
    def mixing(self) -> tuple[int, ...]:
        """See `TaskSettings`: places that a block is carried to."""
        return tuple(index for index, kind in enumerate(self.kinds) if kind == "carry")
