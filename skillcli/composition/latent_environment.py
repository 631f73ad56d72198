"""The environment seen from above: the frozen policy is part of it, and an action is a latent held for a while.

Every latent may be tried on several robots side by side: a plan that holds on all of them has a better chance on one that
nobody has modelled.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np

from skillcli.trajectories import SAFETY_LIMITS, Array

Act = Callable[[Array, Array], Array]  # observations (N, o) and latents (N, d) to actions (N, a)


class Simulations(Protocol):
    """What expanding needs of N simulations."""

    num_envs: int

    def observe(self) -> Array:
        """Observations (N, o)."""

    def step(self, action: Array) -> Any:
        """One control step: observation, reward, terminated, truncated."""

    def set_active(self, ids: Array | None) -> None:
        """Let only these simulations move, all where None; the others may stay as they are."""

    def keypoints(self) -> Array:
        """Points that tell how things stand, (N, L, 3) m, the judged one first."""

    def save(self, ids: Array) -> Array:
        """Whole states, (n, S)."""

    def restore(self, ids: Array, sim_states: Array, /) -> None:
        """Put saved states into slots."""

    def violations(self) -> Array:
        """Which safety limits the present state breaks, (N, K) bool."""


@dataclass(frozen=True)
class Outcome:
    """What held latents led to."""

    path: Array  # (n, M, T+1, L, 3) m, keypoints on M robots, the judged one first; row 0 before the first step
    failed: Array  # (n, M) bool
    sim_states: Array  # (n, S) whole states of all robots behind the last step
    observation: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))  # (n, M, o) what the policy sees there


class LatentEnvironment:
    """Holds latents in many slots at once; states are saved and restored, so no prefix is ever replayed.

    Args:
        env: simulations, `robots` for each slot: simulation i is a robot of the kind i modulo `robots`.
        act: the frozen policy.
        robots: M, on which every latent is tried side by side.
        limits: names out of `SAFETY_LIMITS`; a latent fails where a robot breaks one of them. From states that were measured
            only what their noise cannot break by itself.
    """

    def __init__(self, env: Simulations, act: Act, robots: int = 1, limits: Collection[str] = ()) -> None:
        self._env, self._act, self.robots = env, act, robots
        self.limits = limits
        self.slots = env.num_envs // robots
        self.control_steps = 0  # spent so far, over all robots in use
        self.held = 0  # latents that were held so far, each from one state

    def start(self) -> tuple[Array, Array]:
        """State (S,) and keypoints (M, L, 3) m of slot 0 as it stands."""
        first = np.arange(self.robots)
        return self._env.save(first).ravel(), self._env.keypoints()[first]

    def observe(self, sim_state: Array) -> Array:
        """What the policy sees in a state, (S,) to (M, o)."""
        first = np.arange(self.robots)
        self._env.restore(first, sim_state.reshape(self.robots, -1))
        seen: Array = self._env.observe()[first]
        return seen

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        """From states (n, S), hold latents (n, d) for some control steps, n as large as it may be."""
        parts = [
            self._hold(sim_states[first:][: self.slots], latent[first:][: self.slots], steps)
            for first in range(0, len(sim_states), self.slots)
        ]
        return Outcome(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)))

    def _broken(self) -> Array:
        """Which simulations break one of the limits that are kept, (N,) bool."""
        violations = self._env.violations()
        kept = np.array([name in self.limits for name in SAFETY_LIMITS[: violations.shape[1]]], dtype=bool)
        broken: Array = (violations & kept).any(axis=1)
        return broken

    def _hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        """The same from as many states as there are slots, at most."""
        count, robots = len(sim_states), self.robots
        used = np.arange(count * robots)
        held = np.zeros((self._env.num_envs, latent.shape[1]))
        held[used] = np.repeat(latent, robots, axis=0)
        self._env.restore(used, sim_states.reshape(count * robots, -1))
        path = [self._env.keypoints()[used]]
        failed = np.zeros(len(used), dtype=bool)
        observation = self._env.observe()
        self._env.set_active(used)
        for _ in range(steps):
            step = self._env.step(self._act(observation, held))
            observation = step.observation
            failed |= step.terminated[used]
            if self.limits:
                failed |= self._broken()[used]
            path.append(self._env.keypoints()[used])
        self._env.set_active(None)
        self.control_steps += steps * len(used)
        self.held += count
        along = np.stack(path, axis=1)
        return Outcome(
            path=along.reshape(count, robots, *along.shape[1:]),
            failed=failed.reshape(count, robots),
            sim_states=self._env.save(used).reshape(count, -1),
            observation=observation[used].reshape(count, robots, -1),
        )
