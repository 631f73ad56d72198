"""What goes into an exported policy and what comes out: each column by name, unit and order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from skillcli.evaluation.library import Library
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.environment import ObservationTerm
from skillcli.simulation.targets import command_range
from skillcli.tasks.world import World
from skillcli.trajectories import Array

MEASURED = "joint_position"  # the observed term that a target is compared with
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Port:
    """One input or output: N rows of float32."""

    name: str
    unit: str
    order: tuple[str, ...]  # what each column is
    meaning: str

    @property
    def shape(self) -> tuple[str, int]:
        """Return the shape; N is free."""
        return "N", len(self.order)

    def json(self) -> dict[str, Any]:
        """Return it for metadata and results."""
        return {
            "name": self.name,
            "type": "float32",
            "shape": list(self.shape),
            "unit": self.unit,
            "order": list(self.order),
            "meaning": self.meaning,
        }


@dataclass(frozen=True, eq=False)
class Targets:
    """What an arm's commanded targets are held to."""

    measured: slice  # columns of the observation that hold the joint angles
    low: Array  # (J,) rad, -inf without a limit
    high: Array  # (J,) rad, inf without a limit
    lead: float  # how far a target may be from the measured angle, rad

    @staticmethod
    def of(world: World) -> Targets | None:
        """Return those of an arm; None if the task has none, or does not observe the joint angles."""
        terms = world.observation_terms
        columns = dict(zip((term.name for term in terms), columns_of(terms), strict=True))
        model = world.model()
        if not world.spec.uses_robot or MEASURED not in columns or model is None:
            return None
        low, high = command_range(model, world.robot.names).T
        return Targets(columns[MEASURED], low, high, ArmBatch.MAX_TRACKING_ERROR)


def columns_of(terms: Iterable[ObservationTerm]) -> list[slice]:
    """Return the columns of each term in the observation."""
    ends = np.cumsum([0, *(term.size for term in terms)]).tolist()
    return [slice(first, end) for first, end in pairwise(ends)]


def joint_names(world: World) -> tuple[str, ...]:
    """Return the names of the joints in order, as in the robot file; of a task without an arm, none."""
    return world.robot.description.joints if world.spec.uses_robot else ()


def action_unit(world: World) -> str:
    """Return the unit of an increment."""
    return "rad" if world.spec.uses_robot else "m"


def inputs_of(library: Library, targets: Targets | None) -> tuple[Port, ...]:
    """Return the inputs of a library's policy."""
    world, terms = library.world, library.world.observation_terms
    joints = joint_names(world)
    units = ", ".join(dict.fromkeys(term.unit or "1" for term in terms))
    observed = tuple(f"{term.name} {part}" for term in terms for part in _parts(term, joints))
    latent = tuple(f"z{k + 1}" for k in range(library.mean.shape[1]))
    ports = (
        Port("observation", units, observed, "raw, as measured: the normaliser is inside"),
        Port("latent", "1", latent, "what to do: the mean of a skill, a combination, or that of a plan's segment"),
    )
    if targets is None:
        return ports
    return (*ports, Port("commanded", "rad", joints, "the target that was sent last; before the first, the start"))


def outputs_of(library: Library, targets: Targets | None) -> tuple[Port, ...]:
    """Return the outputs of a library's policy."""
    world, unit = library.world, action_unit(library.world)
    order = joint_names(world) or AXES[: world.sizes[1]]
    limit = world.task.action_scale
    ports = (
        Port("action", f"{limit!r} {unit}", order, "what the network says, in units of the action limit, not clipped"),
        Port("increment", unit, order, f"the action times the limit, clipped to ±{limit!r} {unit}"),
    )
    if targets is None:
        return ports
    meaning = (
        f"commanded + increment, at most {targets.lead!r} rad from the measured angle and inside the joint range: send it, and"
        " give it as `commanded` next time"
    )
    return (*ports, Port("target", "rad", order, meaning))


def _parts(term: ObservationTerm, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Name the columns of a term: joints, axes, or numbers."""
    if term.size == len(joints) and term.unit == "rad":
        return joints
    return AXES[: term.size] if term.size <= len(AXES) and term.unit == "m" else tuple(f"{k + 1}" for k in range(term.size))
