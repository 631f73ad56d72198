"""Interpolate between skills: chains of holds and blends, and how the end of an episode depends on the share λ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli import metrics
from skillcli.composition.method import (
    Finding,
    MethodSettings,
    MethodSpec,
    Option,
    PlanningProblem,
    WrittenRequest,
    WrittenRoute,
)
from skillcli.composition.sequence import Entry, plan, skill_index
from skillcli.config.base import value
from skillcli.errors import UsageError
from skillcli.kinds.compose import CalibrationResults
from skillcli.trajectories import Array

SETS = ("pairs", "neighbours")  # named tasks of many routes, one for each pair of skills


class InterpolateSettings(MethodSettings):
    """Hold the mean of one skill, blend into that of the next, hold it, and so on."""

    skills: str = value("", "skills to go through, such as 3,4,8,7, where no named task is given")
    hold: float = value(1.0, "how long each mean is held", "s", gt=0, le=60)
    blend: float = value(1.0, "how long each blend from one mean to the next takes", "s", gt=0, le=60)
    shares: int = value(11, "latents (1-λ) z_a + λ z_b per pair of skills, λ from 0 to 1, for the calibration", ge=3, le=101)


def chain(skills: Sequence[int], names: Sequence[str], hold: float, blend: float) -> list[Entry]:
    """Hold the first skill, blend into the next, hold it, and so on; durations in s."""
    entries: list[Entry] = []
    for before, skill in zip((None, *skills), skills, strict=False):
        if before is not None:
            entries.append(Entry(f"{names[before]}~{names[skill]}", before, skill, None, blend))
        entries.append(Entry(names[skill], skill, None, None, hold))
    return entries


def all_pairs(skills: int) -> list[tuple[int, int]]:
    """Return every pair (a, b), a < b."""
    return [(a, b) for a in range(skills) for b in range(a + 1, skills)]


@dataclass(frozen=True)
class Calibration:
    """Where episodes end that hold the latent (1-λ) z_a + λ z_b from start to end.

    The end is projected on the line from the goal of a (f = 0) to the goal of b (f = 1). The error of a latent is |f - λ|.
    The distance of the end from that line, m, is reported beside it and is not part of the error.
    """

    pair: Array  # (P, 2) skills
    share: Array  # (S,) λ
    end: Array  # (P, S, 3) m
    goals: Array  # (K, 3) m

    def arrays(self) -> dict[str, Array]:
        """Return the arrays as the store keeps them."""
        return {"calibration/pair": self.pair, "calibration/share": self.share, "calibration/end": self.end}

    def summary(self, names: Sequence[str]) -> dict[str, Any]:
        """Summarize errors per pair, over all pairs, and over neighbouring pairs: those with no other goal between."""
        near = set(metrics.neighbours(self.goals))
        pairs = []
        for (a, b), end in zip(self.pair.tolist(), self.end, strict=True):
            found = metrics.interpolation_calibration(end, self.goals[a], self.goals[b], self.share)
            pairs.append({"from": names[a], "to": names[b], "neighbours": (a, b) in near, **found})
        return {
            "pairs": pairs,
            "shares": self.share.tolist(),
            **_summary(pairs),
            "neighbours": _summary([pair for pair in pairs if pair["neighbours"]]),
        }


def _summary(pairs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    def mean(key: str) -> float | None:
        return float(np.mean([pair[key] for pair in pairs])) if pairs else None

    return {
        "pair_count": len(pairs),
        "mean_error": mean("error"),
        "mean_error_at_half": mean("error_at_half"),
        "mean_off_line_m": mean("off_line_m"),
        "monotone_share": mean("monotone"),
    }


def write(request: WrittenRequest) -> list[WrittenRoute]:
    """Write chains through skills, one route each; the goals of the skills are the waypoints."""
    settings, task = request.settings, request.task
    assert isinstance(settings, InterpolateSettings)
    if request.goals:
        raise UsageError("--method interpolate goes through skills, not to goals", "give --skills or --task, or another method")
    if not task and not settings.skills:
        task = next(iter(request.chains), "neighbours")
    chains = _pairs(task, request.places) if task in SETS else [_chain(request, task or settings.skills)]
    return [
        WrittenRoute(tuple(chain(skills, request.names, settings.hold, settings.blend)), request.places[list(skills)])
        for skills in chains
    ]


def _pairs(task: str, places: Array) -> list[tuple[int, int]]:
    pairs = all_pairs(len(places)) if task == "pairs" else metrics.neighbours(places)
    if not pairs:
        raise UsageError("no skills are given to interpolate between", "give at least two skills: --skills 3,4,8,7")
    return pairs


def _chain(request: WrittenRequest, task: str) -> list[int]:
    settings, known = request.settings, request.chains
    assert isinstance(settings, InterpolateSettings)
    text = known.get(task, "" if task and task != settings.skills else task)
    if not text:
        raise UsageError(
            f"no interpolation {task!r} for the {request.task_name} task",
            f"interpolations: {', '.join((*known, *SETS))}; or give --skills, such as 3,4,8,7",
        )
    skills = [skill_index(word, request.names) for word in text.replace(",", " ").split()]
    if len(skills) < 2:
        raise UsageError(f"{text!r} names fewer than two skills", "give at least two, such as 3,4,8,7")
    return skills


def calibrate(problem: PlanningProblem) -> Finding:
    """Hold the latents between every pair of skills for a whole episode and measure where it ends."""
    pair = np.array(all_pairs(len(problem.mean)), dtype=int).reshape(-1, 2)
    share = np.linspace(0, 1, problem.settings_as(InterpolateSettings).shares)
    a, b = (problem.mean[pair[:, side]][:, None] for side in (0, 1))  # (P, 1, d)
    latent = ((1 - share[:, None]) * a + share[:, None] * b).reshape(-1, problem.mean.shape[1])
    end = problem.hold_to_end(latent, problem.goals[np.repeat(pair[:, 1], len(share))])
    calibration = Calibration(pair, share, end.reshape(len(pair), len(share), 3), problem.goals)
    spent = len(latent) * problem.horizon * problem.period
    results = CalibrationResults.read(calibration.summary(problem.names))
    return Finding(calibration.arrays(), {"calibration": results}, spent)


METHOD = MethodSpec(
    name="interpolate",
    settings=InterpolateSettings,
    plan=plan,
    hint="hold longer with --hold and --blend",
    options=(
        Option("skills", "Skills to go through, such as 3,4,8,7.", "A,B,…"),
        Option("hold", "How long each skill is held, 1 s by default.", "SECONDS", float),
        Option("blend", "How long each blend takes, 1 s by default.", "SECONDS", float),
    ),
    write=write,
    examine=calibrate,
)
