"""The environment seen from above: the frozen policy is part of it, and an action is a latent held for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np

from skillcli.trajectories import Array

Act = Callable[[Array, Array], Array]  # observations (N, o) and latents (N, d) to actions (N, a)


class Simulations(Protocol):
    """What expanding needs of N simulations."""

    num: int

    def observe(self) -> Array:
        """Observations (N, o)."""

    def step(self, action: Array) -> Any:
        """One control step: observation, reward, terminated, truncated."""

    def landmarks(self) -> Array:
        """Points that tell how things stand, (N, L, 3) m, the judged one first."""

    def save(self, ids: Array) -> Array:
        """Whole states, (n, S)."""

    def restore(self, ids: Array, rows: Array) -> None:
        """Put saved states into slots."""


@dataclass(frozen=True)
class Outcome:
    """What held latents led to."""

    path: Array  # (n, T+1, L, 3) m, of the landmarks, the judged point first; row 0 before the first step
    failed: Array  # (n,) bool
    rows: Array  # (n, S) whole states behind the last step
    observation: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (n, o) what the policy sees there


class LatentEnvironment:
    """Holds latents in N slots at once; states are saved and restored, so no prefix is ever replayed."""

    def __init__(self, env: Simulations, act: Act) -> None:
        self._env, self._act = env, act
        self.control_steps = 0  # spent so far, over all slots in use
        self.held = 0  # latents that were held so far, each from one state

    def start(self) -> tuple[Array, Array]:
        """State (S,) and landmarks (L, 3) of slot 0 as it stands."""
        return self._env.save(np.array([0]))[0], self._env.landmarks()[0]

    def observe(self, row: Array) -> Array:
        """What the policy sees in a state, (S,) to (o,)."""
        self._env.restore(np.array([0]), row[None])
        seen: Array = self._env.observe()[0]
        return seen

    def hold(self, rows: Array, latent: Array, steps: int) -> Outcome:
        """From states (n, S), hold latents (n, d) for some control steps, n as large as it may be."""
        parts = [
            self._hold(rows[first : first + self._env.num], latent[first : first + self._env.num], steps)
            for first in range(0, len(rows), self._env.num)
        ]
        return Outcome(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)))

    def _hold(self, rows: Array, latent: Array, steps: int) -> Outcome:
        used = np.arange(len(rows))
        held = np.zeros((self._env.num, latent.shape[1]))
        held[used] = latent
        self._env.restore(used, rows)
        path = [self._env.landmarks()[used]]
        failed = np.zeros(len(rows), dtype=bool)
        observation = self._env.observe()
        for _ in range(steps):
            step = self._env.step(self._act(observation, held))
            observation = step.observation
            failed |= step.terminated[used]
            path.append(self._env.landmarks()[used])
        self.control_steps += steps * len(rows)
        self.held += len(rows)
        return Outcome(np.stack(path, axis=1), failed, self._env.save(used), observation[used])
