"""What an exported policy says about itself: texts of JSON by name, numbers in full precision."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skillcli import __version__
from skillcli.composition.plan import Plan, Segment
from skillcli.evaluation.library import Library
from skillcli.execution.policy_graph import Weights
from skillcli.execution.policy_ports import Port, Targets, action_unit, columns_of, joint_names
from skillcli.execution.policy_samples import start_sample
from skillcli.kinds import COMPOSE
from skillcli.robots.posture import joint_ranges
from skillcli.robots.scene import LIMIT_MARGIN
from skillcli.store import Artifact
from skillcli.store.canonical_json import plain
from skillcli.store.provenance import package_versions
from skillcli.tasks.world import World
from skillcli.trajectories import Array

FORMAT = {"name": "skill-policy", "version": 1}


def describe_policy(
    library: Library,
    artifact: Artifact,
    weights: Weights,
    targets: Targets | None,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
) -> dict[str, str]:
    """Return the metadata; what has no limit is null there, and a task without an arm has neither robot nor joints."""
    world, source = library.world, library.source
    observation, state = start_sample(library)
    said: dict[str, Any] = {
        "format": FORMAT,
        "tool": {"name": "skill", "version": __version__, "mujoco": package_versions()["mujoco"]},
        "source": {
            "id": str(artifact.id),
            "kind": artifact.kind,
            "content_sha256": artifact.content_sha256,
            "library": {"id": str(source.id), "content_sha256": source.content_sha256},
        },
        "task": {"name": world.task.name, "tolerance_m": world.task.tolerance, "horizon_steps": world.task.horizon},
        "control_period_s": world.task.control_period,
        "network": {"layers": len(weights.layers), "latent": "affine" if weights.linear else "input"},
        "robot": _robot(world),
        "joints": _joints(world, targets, state),
        "action": _action(world, targets),
        "start": {"observation": observation},
        "observation": _observation(world),
        "latents": dict(zip(library.names, library.mean, strict=True)),
        "goals_m": dict(zip(library.names, library.goals, strict=True)),
        "inputs": [port.json() for port in inputs],
        "outputs": [port.json() for port in outputs],
    }
    if COMPOSE.is_kind_of(artifact):
        said["plan"] = _plan(library, artifact)
    return {key: json.dumps(plain(value, key), allow_nan=False) for key, value in said.items()}


def _robot(world: World) -> dict[str, Any] | None:
    if not world.spec.uses_robot:
        return None
    robot = world.robot
    base = robot.description.base
    return {"name": robot.name, "fingerprint": robot.fingerprint, "base": {"pos_m": base.pos, "quat_wxyz": base.quat}}


def _joints(world: World, targets: Targets | None, state: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Describe the joints from the base to the hand, in rad; `low` and `high` are the joint's own range."""
    if not world.spec.uses_robot:
        return []
    robot = world.robot
    columns: dict[str, Sequence[Any] | Array] = {
        "name": joint_names(world),
        "low_rad": joint_ranges(robot.model, robot.names.joints)[:, 0],
        "high_rad": joint_ranges(robot.model, robot.names.joints)[:, 1],
        "home_rad": robot.home,
        "speed_limit_rad_s": robot.speed_limit,
    }
    if "joint_position" in state:
        columns["start_rad"] = state["joint_position"]
    if targets is not None:
        columns |= {"lowest_target_rad": targets.low, "highest_target_rad": targets.high}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _action(world: World, targets: Targets | None) -> dict[str, Any]:
    said: dict[str, Any] = {"unit": action_unit(world), "limit": world.task.action_scale}
    if targets is None:
        return {"meaning": "increment of the position, each axis clipped to the limit, once every control period", **said}
    return {
        "meaning": "increment of the commanded target of each joint, not of the measured angle; clipped to the limit, once"
        " every control period. The target leads the measured angle by at most max_tracking_error_rad, and stays inside the"
        " joint's range by range_margin_rad",
        **said,
        "max_tracking_error_rad": targets.lead,
        "range_margin_rad": LIMIT_MARGIN,
    }


def _observation(world: World) -> list[dict[str, Any]]:
    terms = world.observation_terms
    return [
        {**term._asdict(), "first": columns.start, "last": columns.stop - 1}
        for term, columns in zip(terms, columns_of(terms), strict=True)
    ]


def _plan(library: Library, artifact: Artifact) -> dict[str, Any]:
    """Describe the plan: each route is played from the start, its segments one after another."""
    arrays, results = artifact.arrays, COMPOSE.results_of(artifact)
    period = float(library.recipe.task.control_period)
    plan = Plan.read(arrays, period, [segment.skill for segment in results.segments])
    return {
        "method": results.method,
        "task": results.task,
        "routes": [
            {
                "segments": [_segment(segment, period) for segment in route],
                "waypoints_m": arrays["waypoints/target"][arrays["waypoints/route"] == number],
            }
            for number, route in enumerate(plan.routes)
        ],
    }


def _segment(segment: Segment, period: float) -> dict[str, Any]:
    """Describe a segment; a blend goes from `latent` to `latent_end` in even steps and excludes both."""
    return {
        "skill": segment.label,
        "steps": segment.steps,
        "seconds": segment.steps * period,
        "latent": segment.latent,
        "latent_end": None if segment.until is None else np.asarray(segment.until),
    }
