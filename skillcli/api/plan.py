"""`ComposedPlan`: a composition in memory, which can be stored."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from skillcli.trajectories import Array, Trajectories

if TYPE_CHECKING:
    from skillcli.evaluation.episode_schedule import EpisodeSchedule
    from skillcli.kinds.compose import ComposeResults, PlannedSegment
    from skillcli.store import ArtifactId, Draft, Store


@dataclass(frozen=True, eq=False)
class ComposedPlan:
    """Latents to hold one after the other, made by `SkillLibrary.plan`, and their execution where they were planned.

    Attributes:
        store: that `save` writes to.
        source: id of the library's artifact.
        draft: what `save` stores.
    """

    store: Store
    source: ArtifactId
    draft: Draft

    def __repr__(self) -> str:
        """Say whether it succeeds, and what is held for how long."""
        held = " ".join(f"{segment.skill}:{segment.seconds:.2f}s" for segment in self.segments)
        return f"ComposedPlan({'success' if self.success else 'failed'}, {self.final_distance_m:.3f} m, {held})"

    @cached_property
    def results(self) -> ComposeResults:
        """Return everything that `skill compose --json` reports, typed."""
        from skillcli.kinds import COMPOSE

        return COMPOSE.results.read(self.draft.results)

    @property
    def segments(self) -> tuple[PlannedSegment, ...]:
        """Return what is held: `skill`, `latent` (d,), `seconds`, `route` of each."""
        return self.results.segments

    @property
    def success(self) -> bool:
        """Return whether every waypoint is met and no safety limit is violated."""
        return self.results.success

    @property
    def final_distance_m(self) -> float:
        """Return the distance of the end to the last goal, m."""
        return self.results.final_distance_m

    @property
    def latent(self) -> Array:
        """Return the latents of the segments, (S, d)."""
        return self.draft.arrays["plan/latent"]

    @property
    def seconds(self) -> Array:
        """Return how long each segment is held, (S,) s."""
        return self.draft.arrays["plan/seconds"]

    @cached_property
    def trajectories(self) -> Trajectories:
        """Return the execution where it was planned, one episode for each route."""
        prefix = "trajectories/"
        return Trajectories(
            **{path.removeprefix(prefix): array for path, array in self.draft.arrays.items() if path.startswith(prefix)}
        )

    @property
    def schedule(self) -> EpisodeSchedule:
        """Return the latent of every control step, and the waypoints."""
        from skillcli.evaluation.episode_schedule import EpisodeSchedule

        return EpisodeSchedule.of_plan(self.draft.arrays, self.draft.recipe["task"]["control_period"])

    def save(self, name: str | None = None) -> str:
        """Store it as `skill compose` does.

        Args:
            name: first part of the new id; by default that of the library.

        Returns:
            The new id, which the command line and `skillcli.evaluate` take.

        Raises:
            StoreError: the store refuses.
        """
        return str(self.store.write(self.draft if name is None else replace(self.draft, name=name)).id)
