"""What the results of each kind hold: the keys that tables, figures and later stages read, with their types.

More may stand there. What an earlier skill did not write is optional, or comes in by migration.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillcli.store.artifact import ORIGIN
from skillcli.store.schema import LARGEST

Form = Any
"""A type (int, float, bool, str), a mapping from keys to forms, `ListOf`, `DictOf`, or `Maybe` one of these."""


@dataclass(frozen=True)
class ListOf:
    """A list."""

    of: Form
    count: int = 0  # exactly so many; 0 for any number


@dataclass(frozen=True)
class DictOf:
    """An object with any keys."""

    of: Form


@dataclass(frozen=True)
class Maybe:
    """A form, or null."""

    form: Form


@dataclass(frozen=True)
class Optional:
    """What may be absent; an earlier skill did not say it."""

    form: Form


POINT, INTERVAL = ListOf(float, 3), ListOf(float, 2)
# null where no episode ended anywhere
DISTANCES = {
    **dict.fromkeys(("mean", "median", "p90"), Maybe(float)),
    **dict.fromkeys(("p10", "p25", "p75"), Optional(Maybe(float))),
}
OUTCOME = {
    "episodes": int,
    "successes": int,
    "success_rate": float,
    "ci95": INTERVAL,
    "final_distance_m": DISTANCES,
    "deterministic": Optional(bool),
    "unstable": Optional(int),
    "gave_up": Optional(int),
}
WORST = {"episode": int, "final_distance_m": Maybe(float), "success": bool, "parameters": DictOf(float)}

_PRETRAIN = {
    "env_steps": int,
    "success_rate": float,
    "skills": ListOf({"name": str, "goal": POINT, "final_distance_m": float, "success_rate": float}),
    "embedding": {
        "inference_accuracy": float,
        "latent_goal_correlation": Maybe(float),
        "efficiency": Maybe(float),
    },
    "randomised": Optional(Maybe({"episodes": int, "success_rate": float, "ci95": INTERVAL, "final_distance_m": DISTANCES})),
}
_EMBED_MEANS = {
    "skills": ListOf({"name": str, "mean": ListOf(float), "std": ListOf(float), "final_distance_m": float}),
    "halfway": ListOf({
        "from": str,
        "to": str,
        "final_distance_m": float,
        "moved_m": POINT,
        "direction_error_deg": Maybe(float),
        "magnitude_ratio": Maybe(float),
    }),
    "latent_goal_correlation": Maybe(float),
    "efficiency": Maybe(float),
    "inference_accuracy": float,
}  # fmt: skip
_CALIBRATED = {
    "pair_count": int,
    **dict.fromkeys(("mean_error", "mean_error_at_half", "mean_off_line_m", "monotone_share"), Maybe(float)),
}
_CALIBRATED_PAIR = {
    "from": str, "to": str, "neighbours": bool, "error": float, "error_at_half": float, "monotone": bool, "off_line_m": float,
}  # fmt: skip
_COMPOSE = {
    "method": str,
    "task": str,
    "success": bool,
    "success_rate": float,
    "routes": int,
    "expanded_nodes": int,
    "simulated_robot_seconds": float,
    "plan_seconds": float,
    "segments": ListOf(
        {"skill": str, "latent": ListOf(float), "seconds": float, "route": int, "latent_end": Optional(ListOf(float))}
    ),
    "waypoints": ListOf({"target": POINT, "closest_m": float, "route": int}),
    "final_distance_m": float,
    "final_distances_m": ListOf(float),
    "robot_seconds_with_returns": Optional(float),
    "waypoints_met": Optional(bool),
    "violations": Optional(DictOf(int)),
    "broken": Optional(
        ListOf({
            "route": int, "limit": str, "control_steps": int, "seconds": float, "segment": int, "gripper_m": POINT,
        })
    ),
    "on": Optional(str),
    "robots": Optional(int),
    "calibration": Optional({
        **_CALIBRATED, "pairs": ListOf(_CALIBRATED_PAIR), "shares": ListOf(float), "neighbours": _CALIBRATED,
    }),
}  # fmt: skip
_TRANSFER_EVAL = {
    "source": {
        "success_rate": float,
        "episodes": int,
        "final_distance_m": float,
        "success_rate_within_limits": Optional(float),
        "violations": Optional(DictOf(int)),
    },
    "domains": ListOf({
        "name": str,
        **OUTCOME,
        "retention": Maybe(float),
        "parameters": DictOf(str),
        "gap": Optional(float),
        "gap_ci95": Optional(INTERVAL),
        "successes_within_limits": Optional(int),
        "violations": Optional(DictOf(int)),
        "replay_error_m": Optional(DISTANCES),
        "worst": Optional(ListOf(WORST)),
        "sensitivity": Optional(ListOf({"parameter": str, **OUTCOME})),
    }),
    "robot": Optional(Maybe({"file": str, "fingerprint": str})),
    "replanned": Optional(bool),
}  # fmt: skip

RESULTS: Mapping[str, Mapping[str, Form]] = {
    "pretrain": _PRETRAIN,
    "embed-means": _EMBED_MEANS,
    "compose": _COMPOSE,
    "transfer-eval": _TRANSFER_EVAL,
}
"""By kind, in the present schema."""

_ORIGIN = {ORIGIN: Optional({"id": str, "content_sha256": str, "command": str})}
MEASURED: Mapping[str, Mapping[str, Form]] = {
    "pretrain": {
        "wall_seconds": float,
        "throughput": {"env_steps_per_second": float, "sampling_ratio": Maybe(float), "training_ratio": Maybe(float)},
        **_ORIGIN,
    },
    "embed-means": _ORIGIN,
    "compose": {"planning_seconds": float, **_ORIGIN},
    "transfer-eval": _ORIGIN,
}
"""The same of what was measured on the way."""


def complaints(kind: str, results: Mapping[str, Any], measured: Mapping[str, Any]) -> Iterator[str]:
    """What results and measurements lack of what their kind says, one line each."""
    yield from _against(RESULTS[kind], results, "results")
    yield from _against(MEASURED[kind], measured, "measured")


def _against(form: Form, found: Any, where: str) -> Iterator[str]:
    if isinstance(form, Maybe):
        if found is not None:
            yield from _against(form.form, found, where)
    elif isinstance(form, type):
        if not _is(form, found):
            yield f"{where} must be {_SAID[form]}, got {_shown(found)}"
    elif isinstance(form, ListOf):
        yield from _entries(form, found, where)
    elif not isinstance(found, dict):
        yield f"{where} must be an object, got {_shown(found)}"
    elif isinstance(form, DictOf):
        for key, item in found.items():
            yield from _against(form.of, item, f"{where}.{key[:40]!r}")
    else:
        yield from _keys(form, found, where)


def _entries(form: ListOf, found: Any, where: str) -> Iterator[str]:
    if not isinstance(found, list):
        yield f"{where} must be a list, got {_shown(found)}"
    elif form.count and len(found) != form.count:
        yield f"{where} must have {form.count} entries, got {len(found)}"
    else:
        for index, item in enumerate(found):
            yield from _against(form.of, item, f"{where}[{index}]")


def _keys(form: Mapping[str, Form], found: Mapping[str, Any], where: str) -> Iterator[str]:
    for key, wanted in form.items():
        if key in found:
            yield from _against(wanted.form if isinstance(wanted, Optional) else wanted, found[key], f"{where}.{key}")
        elif not isinstance(wanted, Optional):
            yield f"{where}.{key} is missing"


def _is(form: type, found: Any) -> bool:
    if isinstance(found, bool) or form in (str, bool):
        return form is type(found)
    return isinstance(found, int if form is int else int | float) and abs(found) <= LARGEST


_SAID = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


def _shown(found: Any) -> str:
    return f"{type(found).__name__} {str(found)[:20]!r}" if isinstance(found, str | int | float) else type(found).__name__
