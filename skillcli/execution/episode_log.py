"""What happened in an execution, step by step, beside its trajectories."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from skillcli.execution.driver import JointState
from skillcli.execution.filter import LIMITED
from skillcli.trajectories import Array


@dataclass
class EpisodeLog:
    """One episode; times are on the clock of `time.monotonic`, s."""

    stamp: list[float] = field(default_factory=list)  # of each reading, T+1
    velocity: list[Array] = field(default_factory=list)  # (J,) rad/s of each reading, T+1
    tick: list[float] = field(default_factory=list)  # of each control step, T
    sent: list[float] = field(default_factory=list)  # when the target was sent, T; the tick if none was
    asked: list[Array] = field(default_factory=list)  # (J,) rad, target of the policy, T
    commanded: list[Array] = field(default_factory=list)  # (J,) rad, target that was sent, T
    limited: list[Array] = field(default_factory=list)  # (L,) bool: what the filter limited, by column of `LIMITED`, T

    steps: int = 0  # control steps whose target was sent

    def read(self, reading: JointState) -> None:
        """Note a reading that was used."""
        self.stamp.append(reading.stamp)
        self.velocity.append(reading.velocity.copy())

    def stepped(self, tick: float, sent: float | None, asked: Array, commanded: Array, why: Iterable[str]) -> None:
        """Note a control step; `sent` is None if no target was sent."""
        self.tick.append(tick)
        self.sent.append(tick if sent is None else sent)
        self.steps += sent is not None
        self.asked.append(asked.copy())
        self.commanded.append(commanded.copy())
        self.limited.append(np.array([name in why for name in LIMITED]))


def log_arrays(logs: list[EpisodeLog], zero: float) -> dict[str, Array]:
    """Return the logs of E episodes as the store keeps them; shorter episodes repeat their last row.

    Args:
        logs: of each episode.
        zero: moment from which times count, s.
    """

    def padded(name: str, more: int) -> Array:
        longest = max(len(log.tick) for log in logs) + more
        rows = [np.array(getattr(log, name)) for log in logs]
        return np.stack([np.concatenate([row, np.repeat(row[-1:], longest - len(row), axis=0)]) for row in rows])

    return {
        "execution/stamp": padded("stamp", 1) - zero,
        "execution/velocity": padded("velocity", 1),
        "execution/tick": padded("tick", 0) - zero,
        "execution/sent": padded("sent", 0) - zero,
        "execution/asked": padded("asked", 0),
        "execution/commanded": padded("commanded", 0),
        "execution/limited": padded("limited", 0),
    }
