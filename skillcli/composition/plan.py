"""A plan: latents, each held for a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillcli.trajectories import Array


@dataclass(frozen=True)
class Choices:
    """The latents a planner may choose from: the skills' means first, then combinations of them."""

    latent: Array  # (C, d)
    skill: Array  # (C,) index of the skill whose mean it is, -1 for a combination
    label: tuple[str, ...]  # (C,) "3", or "3~4" for the latent half-way between skills 3 and 4

    @staticmethod
    def of(means: Array, names: Sequence[str], interpolated: bool) -> Choices:
        """The means (K, d) of K named skills, and the half-way latents of all pairs where asked."""
        skills = len(means)
        pairs = [(a, b) for a in range(skills) for b in range(a + 1, skills)] if interpolated else []
        return Choices(
            latent=np.array([*means, *((means[a] + means[b]) / 2 for a, b in pairs)]),
            skill=np.array([*range(skills), *(-1 for _ in pairs)]),
            label=(*names, *(f"{names[a]}~{names[b]}" for a, b in pairs)),
        )


@dataclass(frozen=True)
class Segment:
    """One latent, held for some control steps."""

    latent: Array  # (d,)
    skill: int  # index, -1 for a combination
    label: str
    steps: int


def schedule(plan: list[Segment]) -> tuple[Array, Array]:
    """What a plan feeds at each control step: latents (T, d) and skills (T,)."""
    latent = np.concatenate([np.tile(segment.latent, (segment.steps, 1)) for segment in plan])
    skill = np.concatenate([np.full(segment.steps, segment.skill) for segment in plan])
    return latent, skill
