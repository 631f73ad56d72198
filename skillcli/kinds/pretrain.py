"""Trained skills: weights, latents and evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillcli.kinds.arrays import EMBEDDING, TRAJECTORIES
from skillcli.kinds.outcome import Distances
from skillcli.kinds.record import Interval, Measured, Point, Record, optional
from skillcli.kinds.spec import CURVE, WEIGHT, Array, Field, KindSpec, Sizes, counted


@dataclass(frozen=True, kw_only=True)
class TrainedSkill(Record):
    """One skill."""

    name: str
    goal: Point
    final_distance_m: float  # at the mean latent
    success_rate: float  # over sampled latents
    final_yaw_deg: float | None = optional(None)  # of the object at the mean latent, from its start; None without one


@dataclass(frozen=True, kw_only=True)
class EmbeddingQuality(Record):
    """How well the skills are separated; None where it is undefined."""

    inference_accuracy: float
    latent_goal_correlation: float | None
    efficiency: float | None


@dataclass(frozen=True, kw_only=True)
class ObservedTerm(Record):
    """One quantity of the observation, in the order of the list."""

    name: str
    unit: str
    size: int


@dataclass(frozen=True, kw_only=True)
class TrainedRobot(Record):
    """The arm that the skills were trained on."""

    name: str
    joints: tuple[str, ...]  # in the order of actions and joint observations
    fingerprint: str  # of its file and its model


@dataclass(frozen=True, kw_only=True)
class Randomised(Record):
    """The mean latents, evaluated on robots and from starts as varied as in training."""

    episodes: int
    success_rate: float
    ci95: Interval
    final_distance_m: Distances


@dataclass(frozen=True, kw_only=True)
class PretrainResults(Record):
    """Results of a training."""

    env_steps: int
    success_rate: float
    skills: tuple[TrainedSkill, ...]
    embedding: EmbeddingQuality
    randomised: Randomised | None = optional(None, null=True)  # None: nothing was varied
    observation: tuple[ObservedTerm, ...] = optional(())  # empty: an older one, which does not say
    robot: TrainedRobot | None = optional(None)  # None: an older one, or a task without an arm


@dataclass(frozen=True, kw_only=True)
class Throughput(Record):
    """Control steps per second, and shares of the bare engine's; None if not measured."""

    env_steps_per_second: float
    sampling_env_steps_per_second: float | None = optional(None, null=True)
    physics_limit_env_steps_per_second: float | None = optional(None, null=True)
    sampling_ratio: float | None
    training_ratio: float | None


@dataclass(frozen=True, kw_only=True)
class PretrainMeasured(Measured):
    """Cost of a training."""

    wall_seconds: float
    peak_memory_mb: float | None = optional(None, null=True)
    throughput: Throughput


def _check(_arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    yield from counted("results.skills", results["skills"], sizes["skill"])
    if sizes["trajectories: episode"] % sizes["skill"]:
        yield f"{sizes['trajectories: episode']} episodes are not as many for each of {sizes['skill']} skills"
    if sizes["evaluation: sample"] == 0:
        yield "evaluation/latent has no samples"


PRETRAIN = KindSpec(
    name="pretrain",
    version=1,
    fields={
        "weights/**": Field("...", values=WEIGHT),
        "curves/**": Field("iteration", values=CURVE),
        "evaluation/final_distance": Field("skill,sample", "m"),
        "evaluation/latent": Field("skill,sample,latent"),
        "evaluation/inferred": Field("skill,sample,latent"),
        **EMBEDDING,
        **TRAJECTORIES,
    },
    results=PretrainResults,
    measured=PretrainMeasured,
    check=_check,
)
