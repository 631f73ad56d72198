"""A composition: the plan, its waypoints, and its execution where it was planned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.kinds.embed_means import EMBED_MEANS
from skillcli.kinds.outcome import check_domain_name, check_rate
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.record import Interval, Measured, Point, Record, optional
from skillcli.kinds.spec import (
    CURVE,
    POSITIVE,
    WEIGHT,
    Array,
    Arrays,
    Field,
    KindSpec,
    Results,
    Sizes,
    all_or_none,
    counted,
    different,
    divided,
    index,
)

GOALS = "goals"
"""Task name of a composition with given goals instead of a named task."""


@dataclass(frozen=True, kw_only=True)
class PlannedSegment(Record):
    """One latent, or a blend of two, for some time."""

    skill: str
    latent: tuple[float, ...]
    seconds: float
    route: int
    latent_end: tuple[float, ...] | None = optional(None)  # of a blend


@dataclass(frozen=True, kw_only=True)
class Waypoint(Record):
    """One waypoint."""

    target: Point
    closest_m: float
    route: int


@dataclass(frozen=True, kw_only=True)
class Violation(Record):
    """A safety limit that one route violates: for how long, and where first."""

    route: int
    limit: str
    control_steps: int
    seconds: float
    segment: int
    gripper_m: Point


@dataclass(frozen=True, kw_only=True)
class Calibrated(Record):
    """Interpolation error of latents between two skills; None without pairs."""

    pair_count: int
    mean_error: float | None
    mean_error_at_half: float | None
    mean_off_line_m: float | None
    monotone_share: float | None


@dataclass(frozen=True, kw_only=True)
class CalibratedPair(Record):
    """The same for one pair."""

    from_: str
    to: str
    neighbours: bool
    error: float
    error_at_half: float
    monotone: bool
    off_line_m: float


@dataclass(frozen=True, kw_only=True)
class CalibrationResults(Calibrated):
    """Every pair, all pairs together, and the neighbours among them."""

    pairs: tuple[CalibratedPair, ...]
    shares: tuple[float, ...]
    neighbours: Calibrated


@dataclass(frozen=True, kw_only=True)
class Prediction(Record):
    """How often the plan succeeds when it is sent blindly, on robots drawn from a domain."""

    domain: str
    robots: int
    successes: int
    successes_within_limits: int | None = optional(None)
    success_rate: float
    ci95: Interval


@dataclass(frozen=True, kw_only=True)
class ComposeResults(Record):
    """Results of a composition."""

    method: str
    task: str  # a named composition, or `GOALS`
    success: bool  # every route meets its waypoints and violates no limit
    success_rate: float
    routes: int
    expanded_nodes: int
    simulated_robot_seconds: float
    robot_seconds_with_returns: float | None = optional(None)
    plan_seconds: float
    segments: tuple[PlannedSegment, ...]
    waypoints: tuple[Waypoint, ...]
    final_distance_m: float  # the largest
    final_distances_m: tuple[float, ...]  # of each route
    final_yaws_deg: tuple[float, ...] | None = optional(None)  # of the object in each route, from its start; None without one
    waypoints_met: bool | None = optional(None)  # regardless of limits; None: unknown
    violations: Mapping[str, int] = optional({})  # control steps that violate each limit; empty if unknown
    broken: tuple[Violation, ...] = optional(())
    on: str = optional("")  # domain that was planned on, "" for the nominal simulation
    robots: int = optional(1)  # that tried every latent
    predicted: Prediction | None = optional(None)  # of the plan sent blindly
    calibration: CalibrationResults | None = optional(None)  # of interpolations
    notes: tuple[str, ...] | None = optional(None)  # what the method says of its plan, a line each


@dataclass(frozen=True, kw_only=True)
class ComposeMeasured(Measured):
    """Cost of planning."""

    planning_seconds: float


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    routes = sizes["trajectories: episode"]
    for path in ("plan/route", "waypoints/route"):
        if not divided(arrays, path, routes):
            yield f"{path} does not name each of {routes} routes in order"
    for name, wanted in (("segments", sizes["plan: segment"]), ("waypoints", sizes["waypoints: waypoint"])):
        yield from counted(f"results.{name}", results[name], wanted)
    yield from counted("results.final_distances_m", results["final_distances_m"], routes)
    yield from counted("results.final_yaws_deg", results.get("final_yaws_deg", [0.0] * routes), routes)
    yield from all_or_none(arrays, "calibration/pair", "calibration/share", "calibration/end")
    yield from different(arrays, "calibration/pair")
    if (ahead := results.get("predicted")) is not None:
        yield from check_domain_name(ahead["domain"], "results.predicted")
        yield from check_rate(ahead, ahead["robots"])
    if results["routes"] != routes:
        yield f"results.routes is {results['routes']}, there are {routes}"
    said = [*results["segments"], *results["waypoints"], *results.get("broken", ())]
    if not all(0 <= each["route"] < routes for each in said):
        yield "the results name a route that does not exist"


def _from_1(arrays: Arrays, results: Results) -> tuple[Arrays, Results]:
    """Migrate from version 1, which had one route; version 2 has several, each run from the start."""
    routes = {
        f"{folder}/route": np.zeros(len(arrays[field]), dtype=np.int64)
        for folder, field in (("plan", "plan/latent"), ("waypoints", "waypoints/target"))
    }
    routed = {part: [{**entry, "route": 0} for entry in results.get(part, [])] for part in ("segments", "waypoints")}
    success = arrays["trajectories/success"]  # not checked yet: perhaps empty, or no booleans
    added = {
        "routes": 1,
        "success_rate": np.count_nonzero(success) / max(1, success.size),
        "final_distances_m": [results["final_distance_m"]],
    }
    return {**arrays, **routes}, {**results, **routed, **added}


COMPOSE = KindSpec(
    name="compose",
    version=2,
    fields={
        "plan/latent": Field("segment,latent"),
        "plan/seconds": Field("segment", "s", values=POSITIVE),
        "plan/skill": Field("segment", values=index("skill", none=True)),
        "plan/route": Field("segment", values=index("trajectories: episode")),
        "plan/latent_end": Field("segment,latent", required=False),
        "waypoints/target": Field("waypoint,xyz", "m"),
        "waypoints/closest": Field("waypoint", "m"),
        "waypoints/route": Field("waypoint", values=index("trajectories: episode")),
        "calibration/pair": Field("pair,member", required=False, values=index("skill")),
        "calibration/share": Field("share", required=False),
        "calibration/end": Field("pair,share,xyz", "m", required=False),
        "robots/*": Field("robot,...", required=False),
        "composer/**": Field("...", required=False, values=WEIGHT),
        "curves/**": Field("iteration", required=False, values=CURVE),
        **TRAJECTORIES,
    },
    results=ComposeResults,
    measured=ComposeMeasured,
    made_from=(EMBED_MEANS.name, PRETRAIN.name),
    check=_check,
    migrations={1: _from_1},
)
