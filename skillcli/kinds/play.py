"""A play: what somebody did with a library by hand in `skill play`, from the start to the end of one recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.kinds.embed_means import EMBED_MEANS
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.record import Measured, Record, optional
from skillcli.kinds.spec import Array, Field, KindSpec, Sizes, Values, index


@dataclass(frozen=True, kw_only=True)
class PlayedRobot(Record):
    """The simulated arm."""

    name: str
    fingerprint: str  # of its robot file and model


@dataclass(frozen=True, kw_only=True)
class PlayResults(Record):
    """Results of a play: how it ended, at the goal as it was then."""

    success: bool  # within the tolerance at the end, and nothing failed on the way
    failed: bool  # the simulation diverged or the task failed, which ended the recording
    final_distance_m: float
    seconds: float
    violations: Mapping[str, int] = optional({})  # control steps that violate each limit
    robot: PlayedRobot


@dataclass(frozen=True, kw_only=True)
class PlayMeasured(Measured):
    """Where the robot file lay: it may lie elsewhere on another machine."""

    robot_file: str | None = optional(None)  # the whole path, or the name of a bundled robot; None: that of the skills


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    episodes, steps = sizes["trajectories: episode"], sizes["trajectories: step"]
    if episodes != 1:
        yield f"a play has one episode, got {episodes}"
    if sizes["waypoints: waypoint"] != 1:
        yield f"a play has one goal at its end, got {sizes['waypoints: waypoint']}"
    for path, array in arrays.items():
        if path.startswith("play/") and array.shape[:2] != (episodes, steps):
            yield f"{path} has {array.shape[1]} steps, expected {steps}"
    if bool(np.all(arrays["trajectories/success"])) != results["success"]:
        yield "results.success and trajectories/success contradict each other"


PLAY = KindSpec(
    name="play",
    version=1,
    fields={
        "play/goal": Field("episode,step,xyz", "m"),
        "play/latency": Field("episode,step", "s", required=False, values=Values(low=0.0)),
        "play/contact_friction": Field("episode,step", "factor", required=False, values=Values(low=0.0)),
        "play/joint_friction": Field("episode,step", "factor", required=False, values=Values(low=0.0)),
        "play/gain": Field("episode,step", "factor", values=Values(low=0.0)),
        "waypoints/target": Field("waypoint,xyz", "m"),
        "waypoints/closest": Field("waypoint", "m"),
        "waypoints/route": Field("waypoint", values=index("trajectories: episode")),
        **TRAJECTORIES,
    },
    results=PlayResults,
    measured=PlayMeasured,
    made_from=(EMBED_MEANS.name, PRETRAIN.name),
    check=_check,
)
