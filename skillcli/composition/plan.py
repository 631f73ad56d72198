"""A plan: latents, each held for a while; and the form in which it is stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skillcli.kinds.compose import PlannedSegment
from skillcli.trajectories import Array


@dataclass(frozen=True)
class Choices:
    """The latents that a planner may choose from: the means of the skills first, then combinations."""

    latent: Array  # (C, d)
    skill: Array  # (C,) index of the skill whose mean it is, -1 for a combination
    label: tuple[str, ...]  # (C,) "3", or "3~4" for the latent half-way between skills 3 and 4

    @staticmethod
    def of(
        means: Array,
        names: Sequence[str],
        interpolated: bool,
        grid: Array | None = None,
        places: Sequence[tuple[str, Array]] = (),
    ) -> Choices:
        """List the means (K, d) of K named skills, half-way latents of all pairs if asked, a grid (G, d), and named places."""
        skills = len(means)
        pairs = [(a, b) for a in range(skills) for b in range(a + 1, skills)] if interpolated else []
        further = [] if grid is None else [(_coordinates(latent), latent) for latent in grid]
        further += places
        return Choices(
            latent=np.array([*means, *((means[a] + means[b]) / 2 for a, b in pairs), *(latent for _, latent in further)]),
            skill=np.array([*range(skills), *(-1 for _ in (*pairs, *further))]),
            label=(*names, *(f"{names[a]}~{names[b]}" for a, b in pairs), *(label for label, _ in further)),
        )


def latent_grid(low: Array, high: Array, count: int) -> Array:
    """Return a regular grid with `count` latents per dimension between two corners (d,), (count**d, d)."""
    axes = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))


def _coordinates(latent: Array) -> str:
    return "(" + ",".join(f"{x:.2f}" for x in latent) + ")"


@dataclass(frozen=True)
class Segment:
    """One latent held for some control steps, or a blend from it to another."""

    latent: Array  # (d,)
    skill: int  # index, -1 for a combination
    label: str
    steps: int
    until: Array | None = None  # (d,) end of a blend, None if the latent is held

    @property
    def latents(self) -> Array:
        """Return the latent of each control step, (steps, d); a blend is evenly spaced and excludes both ends."""
        share = np.arange(1, self.steps + 1)[:, None] / (self.steps + 1)
        latents: Array = self.latent + share * (self.end - self.latent)
        return latents

    @property
    def end(self) -> Array:
        """Return the last point in the latent space, (d,): the latent itself if it is held."""
        return self.latent if self.until is None else self.until


def schedule(plan: Sequence[Segment]) -> tuple[Array, Array]:
    """Return the latents (T, d) and skills (T,) of each control step of a plan."""
    latent = np.concatenate([segment.latents for segment in plan])
    skill = np.concatenate([np.full(segment.steps, segment.skill) for segment in plan])
    return latent, skill


@dataclass(frozen=True)
class Plan:
    """Segments of one or several routes, each played from the start.

    The store keeps a plan as `plan/latent`, `plan/seconds`, `plan/skill` and `plan/route`, one row per segment, and
    `plan/latent_end` if there are blends. `records` gives the same for people, with labels. `schedules` gives
    `trajectories/latent`.
    """

    routes: tuple[tuple[Segment, ...], ...]

    @property
    def segments(self) -> list[Segment]:
        """Return the segments of all routes in order."""
        return [segment for route in self.routes for segment in route]

    @property
    def route(self) -> Array:
        """Return the route of each segment, (S,)."""
        return np.repeat(np.arange(len(self.routes)), [len(route) for route in self.routes])

    @property
    def steps(self) -> int:
        """Return the control steps of all routes together."""
        return sum(segment.steps for segment in self.segments)

    def schedules(self) -> tuple[Array, Array, Array]:
        """Return latents (R, T, d), skills (R, T) and control steps (R,) of R routes.

        Shorter routes repeat their last latent.
        """
        fed = [schedule(route) for route in self.routes]
        steps = np.array([len(skill) for _, skill in fed])
        rows = [np.minimum(np.arange(steps.max()), count - 1) for count in steps]
        latent = np.stack([latent[row] for (latent, _), row in zip(fed, rows, strict=True)])
        return latent, np.stack([skill[row] for (_, skill), row in zip(fed, rows, strict=True)]), steps

    def arrays(self, period: float) -> dict[str, Array]:
        """Return the arrays as the store keeps them, with control steps of `period` s."""
        segments = self.segments
        arrays = {
            "plan/latent": np.array([segment.latent for segment in segments]),
            "plan/seconds": np.array([segment.steps * period for segment in segments]),
            "plan/skill": np.array([segment.skill for segment in segments]),
            "plan/route": self.route,
        }
        if any(segment.until is not None for segment in segments):
            arrays["plan/latent_end"] = np.array([segment.end for segment in segments])
        return arrays

    def records(self, period: float) -> tuple[PlannedSegment, ...]:
        """Describe each segment for the results."""
        return tuple(
            PlannedSegment(
                skill=segment.label,
                latent=tuple(segment.latent.tolist()),
                seconds=segment.steps * period,
                route=int(route),
                latent_end=None if segment.until is None else tuple(segment.until.tolist()),
            )
            for route, segment in zip(self.route, self.segments, strict=True)
        )

    @staticmethod
    def read(arrays: Mapping[str, Array], period: float, labels: Sequence[str] = ()) -> Plan:
        """Read the plan that `arrays` wrote; only `records` uses the labels."""
        end = arrays.get("plan/latent_end", arrays["plan/latent"])
        steps = np.round(arrays["plan/seconds"] / period).astype(int)
        routes: list[list[Segment]] = [[] for _ in range(int(arrays["plan/route"].max()) + 1)]
        for row, (latent, route) in enumerate(zip(arrays["plan/latent"], arrays["plan/route"], strict=True)):
            until = None if np.array_equal(latent, end[row]) else end[row]
            label = labels[row] if labels else ""
            routes[route].append(Segment(latent, int(arrays["plan/skill"][row]), label, int(steps[row]), until))
        return Plan(tuple(tuple(route) for route in routes))


def stored_steps(arrays: Mapping[str, Array], period: float) -> Array:
    """Read the control steps of each route of a stored plan, (R,), and nothing else of it."""
    steps: Array = np.round(np.bincount(arrays["plan/route"], weights=arrays["plan/seconds"]) / period)
    return steps
