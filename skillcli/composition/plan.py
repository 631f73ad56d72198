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
    def of(means: Array, names: Sequence[str], interpolated: bool, grid: Array | None = None) -> Choices:
        """The means (K, d) of K named skills, the half-way latents of all pairs where asked, and a grid (G, d)."""
        skills = len(means)
        pairs = [(a, b) for a in range(skills) for b in range(a + 1, skills)] if interpolated else []
        further = [] if grid is None else list(grid)
        return Choices(
            latent=np.array([*means, *((means[a] + means[b]) / 2 for a, b in pairs), *further]),
            skill=np.array([*range(skills), *(-1 for _ in (*pairs, *further))]),
            label=(*names, *(f"{names[a]}~{names[b]}" for a, b in pairs), *(_coordinates(latent) for latent in further)),
        )


def latent_grid(low: Array, high: Array, count: int) -> Array:
    """A regular grid of `count` latents per dimension between two corners (d,), (count**d, d)."""
    axes = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))


def _coordinates(latent: Array) -> str:
    return "(" + ",".join(f"{x:.2f}" for x in latent) + ")"


@dataclass(frozen=True)
class Segment:
    """One latent, held for some control steps; or a blend from it to another one."""

    latent: Array  # (d,)
    skill: int  # index, -1 for a combination
    label: str
    steps: int
    until: Array | None = None  # (d,) where a blend leads, None where the latent is held

    @property
    def latents(self) -> Array:
        """What is fed at each control step, (steps, d); a blend lies strictly between its ends, evenly spaced."""
        share = np.arange(1, self.steps + 1)[:, None] / (self.steps + 1)
        latents: Array = self.latent + share * (self.end - self.latent)
        return latents

    @property
    def end(self) -> Array:
        """Where it leads in the latent space, (d,): the latent itself where that is held."""
        return self.latent if self.until is None else self.until


def schedule(plan: list[Segment]) -> tuple[Array, Array]:
    """What a plan feeds at each control step: latents (T, d) and skills (T,)."""
    latent = np.concatenate([segment.latents for segment in plan])
    skill = np.concatenate([np.full(segment.steps, segment.skill) for segment in plan])
    return latent, skill
