"""What may go wrong between an arm and who commands it, on request: for tests, and to see what a failure looks like."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from skillcli.config.base import Section

NEVER = 1e6  # s: longer than any execution


class Fault(Section):
    """Something that breaks, so long after the first command of an episode.

    - stall: readings stay the last one, stamp and all, as if the reader hung
    - freeze: the angles stay, while new stamps come
    - gap: no message arrives from the arm
    - nan: the angle of the first joint is not a number
    - swap: the names of the first two joints change places, and their numbers too
    - drop: commands are lost
    - clock: stamps jump ahead by a minute
    - back: stamps jump back by a minute
    - kill: the process of the arm ends
    """

    kind: Literal["stall", "freeze", "gap", "nan", "swap", "drop", "clock", "back", "kill"]
    at: Annotated[float, Field(ge=0)] = 0.5  # s
    seconds: Annotated[float, Field(gt=0)] = NEVER  # how long; afterwards all is well

    def acts(self, since: float) -> bool:
        """Return whether it acts so many seconds after the first command."""
        return self.at <= since < self.at + self.seconds


class Conditions(Section):
    """How messages travel, in both directions, and what breaks."""

    latency: Annotated[float, Field(ge=0, le=1)] = 0.0  # s, of every message
    jitter: Annotated[float, Field(ge=0, le=1)] = 0.0  # s, at most, in addition
    loss: Annotated[float, Field(ge=0, le=1)] = 0.0  # probability that a reading or a command is lost
    faults: tuple[Fault, ...] = ()

    def delay(self, rng: np.random.Generator) -> float:
        """Draw how long a message travels, s; infinite if it is lost."""
        if self.loss and rng.random() < self.loss:
            return math.inf
        return self.latency + (self.jitter * rng.random() if self.jitter else 0.0)

    def acting(self, since: float) -> set[str]:
        """Return the kinds of the faults that act so many seconds after the first command."""
        return {fault.kind for fault in self.faults if fault.acts(since)}
