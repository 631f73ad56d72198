"""The one interface of everything that composes: it proposes latents to hold, and is told what they led to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.plan import Segment
from skillcli.trajectories import Array


@dataclass(frozen=True)
class Proposal:
    """Latents to hold, each from a state of its own."""

    sim_states: Array  # (n, S) whole states, opaque, as the world gave them
    latent: Array  # (n, d)
    steps: int  # control steps, the same for all


class Planner(Protocol):
    """Proposes and is told, in turn, until it is finished. It never sees the simulator."""

    @property
    def finished(self) -> bool:
        """Whether nothing more is to be tried."""

    @property
    def done(self) -> tuple[int, int, str]:
        """How far it is: units done, of how many at most, and a word on how it goes."""

    def ask(self) -> Proposal:
        """What to try next; only while not finished."""

    def tell(self, outcome: Outcome) -> None:
        """What the last proposal led to."""

    def plan(self) -> list[Segment]:
        """The best plan known so far; empty where nothing has to be done."""


def run(planner: Planner, world: LatentEnvironment, on_progress: Callable[[int, int, str], None]) -> None:
    """Let a planner try latents in a world until it is finished, and tell after each try how far it is."""
    while not planner.finished:
        proposal = planner.ask()
        planner.tell(world.hold(proposal.sim_states, proposal.latent, proposal.steps))
        on_progress(*planner.done)
