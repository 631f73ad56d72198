"""Interpolation between skills: chains of holds and blends, and how faithful the way between two latents is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli import metrics
from skillcli.composition.sequence import Entry
from skillcli.trajectories import Array


def chain(skills: Sequence[int], names: Sequence[str], hold: float, blend: float) -> list[Entry]:
    """Hold the first skill, blend into the next, hold that, and so on; durations in s."""
    entries: list[Entry] = []
    for before, skill in zip((None, *skills), skills, strict=False):
        if before is not None:
            entries.append(Entry(f"{names[before]}~{names[skill]}", before, skill, None, blend))
        entries.append(Entry(names[skill], skill, None, None, hold))
    return entries


def all_pairs(skills: int) -> list[tuple[int, int]]:
    """Every pair (a, b), a < b."""
    return [(a, b) for a in range(skills) for b in range(a + 1, skills)]


@dataclass(frozen=True)
class Calibration:
    """Where the motion ends for latents (1-λ) z_a + λ z_b, held from the start to the end of an episode.

    Error of one latent: |f - λ|, with f the fraction of the way: the end, projected on the line from the goal of a
    (f = 0) to that of b (f = 1). How far the end lies off that line, m, is reported beside it and is no part of the error.
    """

    pair: Array  # (P, 2) skills
    share: Array  # (S,) λ
    end: Array  # (P, S, 3) m
    goals: Array  # (K, 3) m

    def arrays(self) -> dict[str, Array]:
        """As the store keeps it."""
        return {"calibration/pair": self.pair, "calibration/share": self.share, "calibration/end": self.end}

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Per pair and on the whole; the same again over neighbouring skills only, those with no other goal between."""
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
