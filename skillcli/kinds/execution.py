"""An execution: a composition, or bare skills, on an arm behind a driver, real or simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.kinds.compose import COMPOSE
from skillcli.kinds.embed_means import EMBED_MEANS
from skillcli.kinds.outcome import Outcome, check_domain_name, check_rate
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.record import Measured, Record, optional
from skillcli.kinds.spec import TRUTH, Array, Field, KindSpec, Sizes, Values


@dataclass(frozen=True, kw_only=True)
class ExecutedArm(Record):
    """The arm that was driven."""

    name: str
    fingerprint: str  # of its robot file and model


@dataclass(frozen=True, kw_only=True)
class Stopped(Record):
    """Why an execution did not end by itself."""

    reason: str  # one word
    message: str
    episode: int  # from 0, in which it was stopped or before which
    seconds: float  # of the arm's time, since that episode began


@dataclass(frozen=True, kw_only=True)
class ExecutionResults(Outcome):
    """Results of an execution. Distances are as the arm's own sensors show them."""

    driver: str
    robot: ExecutedArm
    domain: str | None = optional(None)  # from which simulated robots were drawn; None: no simulation
    max_speed: float = optional(1.0)  # share of the largest speed
    dry_run: bool = optional(False)  # whether nothing was sent
    replanned: bool = optional(False)  # whether the plan was made again after every segment
    filtered_steps: int  # control steps whose target the filter changed
    filtered: Mapping[str, int] = optional({})  # the same for each limit
    violations: Mapping[str, int] = optional({})  # episodes that violate each safety limit
    stopped: Stopped | None = optional(None, null=True)  # None: it ended by itself


@dataclass(frozen=True, kw_only=True)
class Deadlines(Record):
    """How late targets were sent after the ticks that they answer."""

    steps: int
    missed: int  # later than half a control period
    p99_ms: float


@dataclass(frozen=True, kw_only=True)
class ExecutionMeasured(Measured):
    """The clock of the loop, and where the robot file lay: it may lie elsewhere on another machine."""

    deadlines: Deadlines
    robot_file: str | None = optional(None)  # the whole path, or the name of a bundled robot
    seconds_per_plan: float | None = optional(None)  # with replanning: how long the arm waited for a plan, as a rule


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    episodes, steps = sizes["trajectories: episode"], sizes["trajectories: step"]
    if results["episodes"] != episodes:
        yield f"results.episodes is {results['episodes']}, there are {episodes}"
    yield from check_rate(results, episodes)
    if (domain := results.get("domain")) is not None:
        yield from check_domain_name(domain, "results.domain")
    for path, array in arrays.items():
        if path.startswith("execution/"):
            wanted = (episodes, steps + (path in ("execution/stamp", "execution/velocity")))
            if array.shape[:2] != wanted:
                yield f"{path} has {array.shape[0]} episodes of {array.shape[1]} steps, expected {wanted[0]} of {wanted[1]}"
    if not 0 <= results["filtered_steps"] <= episodes * steps:
        yield f"results.filtered_steps is {results['filtered_steps']}, there are {episodes * steps} steps"


EXECUTION = KindSpec(
    name="execution",
    version=1,
    fields={
        "execution/stamp": Field("episode,step+1", "s"),
        "execution/velocity": Field("episode,step+1,joint", "rad/s"),
        "execution/tick": Field("episode,step", "s"),
        "execution/sent": Field("episode,step", "s"),
        "execution/asked": Field("episode,step,joint", "rad"),
        "execution/commanded": Field("episode,step,joint", "rad"),
        "execution/limited": Field("episode,step,limit", values=TRUTH),
        "episodes/route": Field("episode", values=Values("i", 0)),
        "episodes/final_distance": Field("episode", "m"),
        **TRAJECTORIES,
    },
    results=ExecutionResults,
    measured=ExecutionMeasured,
    made_from=(COMPOSE.name, EMBED_MEANS.name, PRETRAIN.name),
    check=_check,
)
