"""The interface of every planner: it proposes latents to hold, and receives their outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.plan import Segment
from skillcli.trajectories import Array


@dataclass(frozen=True)
class Proposal:
    """Latents to hold, each from its own state."""

    sim_states: Array  # (n, S) whole states, opaque to the planner
    latent: Array  # (n, d)
    steps: int  # control steps, the same for all


class Planner(Protocol):
    """Proposes and receives outcomes in turn until it is finished. It never sees the simulator."""

    @property
    def finished(self) -> bool:
        """Whether the planner has nothing more to try."""

    @property
    def done(self) -> tuple[int, int, str]:
        """Units of work done, how many at most, and a note on the progress."""

    def ask(self) -> Proposal:
        """Propose what to try next; only while not finished."""

    def tell(self, outcome: Outcome) -> None:
        """Take the outcome of the last proposal."""

    def plan(self) -> list[Segment]:
        """Return the best plan so far; empty if nothing has to be done."""


def run(planner: Planner, world: LatentEnvironment, on_progress: Callable[[int, int, str], None]) -> None:
    """Let a planner try latents in a world until it is finished; call `on_progress` after each try."""
    while not planner.finished:
        proposal = planner.ask()
        planner.tell(world.hold(proposal.sim_states, proposal.latent, proposal.steps))
        on_progress(*planner.done)
