"""The numbers of one run that runs are compared by, by name, read from its artifacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isfinite, nan

from skillcli.kinds import COMPOSE, EMBED_MEANS, EXECUTION, PRETRAIN, TRANSFER_EVAL, ByKind
from skillcli.store import Artifact

Named = Iterator[tuple[str, float | None]]

METRICS: ByKind[Callable[[Artifact], Named]] = ByKind("metric to compare")
FIRST = "success_rate"
"""The first metric of every comparison that has it."""

_LOWER = {"final_distance_m", "efficiency", "expanded_nodes"}


def higher_is_better(metric: str) -> bool:
    """Return whether a larger value of a metric is better."""
    return metric.rpartition(".")[2] not in _LOWER


def metric_names(stages: Sequence[str], domains: Sequence[str]) -> list[str]:
    """Return the names of all metrics that a run of these stages may have, with these target domains."""
    ends = {
        PRETRAIN.name: (
            "success_rate", "final_distance_m", "inference_accuracy", "latent_goal_correlation", "efficiency",
            "randomised.success_rate",
        ),
        EMBED_MEANS.name: ("final_distance_m",),
        COMPOSE.name: ("success_rate", "final_distance_m", "expanded_nodes", "predicted.success_rate"),
        TRANSFER_EVAL.name: tuple(
            f"{domain}.{name}" for domain in domains for name in ("success_rate", "final_distance_m", "retention")
        ),
    }  # fmt: skip
    return [name if stage == PRETRAIN.name else f"{stage}.{name}" for stage in stages for name in ends[stage]]


def last_success(names: Iterable[str]) -> list[str]:
    """Return the success among these metrics of a run: that of its last stage that has one, after a transfer of each domain."""
    known = list(names)
    for stage in (TRANSFER_EVAL.name, COMPOSE.name):
        own = [name for name in known if name.startswith(f"{stage}.") and name.endswith(f".{FIRST}")]
        if found := [name for name in own if name != f"{stage}.predicted.{FIRST}"]:
            return found
    return [FIRST] if FIRST in known else []


def metrics_of(artifacts: Iterable[Artifact]) -> dict[str, float]:
    """Return the metrics of the artifacts of one run; those of training have their own name, others the stage in front.

    What is undefined in a run is NaN.
    """
    found: dict[str, float] = {}
    for artifact in artifacts:
        if artifact.kind in METRICS:
            for name, value in METRICS.of(artifact.kind)(artifact):
                full = name if PRETRAIN.is_kind_of(artifact) else f"{artifact.kind}.{name}"
                found[full] = float(value) if value is not None and isfinite(value) else nan
    return found


@METRICS.register(PRETRAIN)
def _trained(artifact: Artifact) -> Named:
    found = PRETRAIN.results_of(artifact)
    yield "success_rate", found.success_rate
    yield "final_distance_m", sum(skill.final_distance_m for skill in found.skills) / len(found.skills)
    yield "inference_accuracy", found.embedding.inference_accuracy
    yield "latent_goal_correlation", found.embedding.latent_goal_correlation
    yield "efficiency", found.embedding.efficiency
    if found.randomised is not None:
        yield "randomised.success_rate", found.randomised.success_rate


@METRICS.register(EMBED_MEANS)
def _embedded(artifact: Artifact) -> Named:
    found = EMBED_MEANS.results_of(artifact)
    yield "final_distance_m", sum(skill.final_distance_m for skill in found.skills) / len(found.skills)


@METRICS.register(COMPOSE)
def _composed(artifact: Artifact) -> Named:
    found = COMPOSE.results_of(artifact)
    yield "success_rate", found.success_rate
    yield "final_distance_m", found.final_distance_m
    yield "expanded_nodes", found.expanded_nodes
    if found.predicted is not None:
        yield "predicted.success_rate", found.predicted.success_rate


@METRICS.register(TRANSFER_EVAL)
def _transferred(artifact: Artifact) -> Named:
    for domain in TRANSFER_EVAL.results_of(artifact).domains:
        yield f"{domain.name}.success_rate", domain.success_rate
        yield f"{domain.name}.final_distance_m", domain.final_distance_m.median
        yield f"{domain.name}.retention", domain.retention


@METRICS.register(EXECUTION)
def _executed(artifact: Artifact) -> Named:
    found = EXECUTION.results_of(artifact)
    yield "success_rate", found.success_rate
    yield "final_distance_m", found.final_distance_m.median
