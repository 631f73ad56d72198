"""The environment as a planner uses it: the frozen policy is part of it, and an action is a latent held for a while.

Every latent may be tried on several robots at once: a plan that works on all of them is more likely to work on an unknown
one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np

from skillcli.composition.plan import Segment
from skillcli.trajectories import SAFETY_LIMITS, Array

Act = Callable[[Array, Array], Array]  # observations (N, o) and latents (N, d) to actions (N, a)


class Simulations(Protocol):
    """What `LatentEnvironment` needs of N simulations."""

    num_envs: int

    def observe(self) -> Array:
        """Return observations (N, o)."""

    def step(self, action: Array) -> Any:
        """Apply one control step; returns observation, reward, terminated, truncated."""

    def set_active(self, ids: Array | None) -> None:
        """Simulate only these; None for all. The others may keep their state, which costs less."""

    def keypoints(self) -> Array:
        """Return the points that describe each state, (N, L, 3) m, the achieved goal first."""

    def save(self, ids: Array) -> Array:
        """Return whole states, (n, S)."""

    def restore(self, ids: Array, sim_states: Array, /) -> None:
        """Put saved states into slots."""

    def violations(self) -> Array:
        """Return which safety limits each state violates, (N, K) bool."""


@dataclass(frozen=True)
class Outcome:
    """What happened when latents were held."""

    path: Array  # (n, M, T+1, L, 3) m, keypoints on M robots, the achieved goal first; row 0 is the start
    failed: Array  # (n, M) bool
    sim_states: Array  # (n, S) whole states of all robots after the last step
    observation: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))  # (n, M, o) observations after the last step


class LatentEnvironment:
    """Holds latents in many simulations at once; states are saved and restored, so no prefix is simulated twice.

    Args:
        env: simulations, `robots` for each slot: simulation i is robot i modulo `robots`.
        act: the frozen policy.
        robots: M, how many robots try every latent.
        limits: names of `SAFETY_LIMITS`; a latent fails if a robot violates one of them. For states that were measured,
            name only limits that measurement noise alone cannot violate.
    """

    def __init__(self, env: Simulations, act: Act, robots: int = 1, limits: Collection[str] = ()) -> None:
        self._env, self._act, self.robots = env, act, robots
        self.limits = limits
        self.slots = env.num_envs // robots
        self.control_steps = 0  # simulated so far, over all robots in use
        self.held = 0  # latents held so far, each from one state

    def start(self) -> tuple[Array, Array]:
        """Return the present state (S,) and keypoints (M, L, 3) m of slot 0."""
        first = np.arange(self.robots)
        return self._env.save(first).ravel(), self._env.keypoints()[first]

    def observe(self, sim_state: Array) -> Array:
        """Return the observations in a state, (S,) to (M, o)."""
        first = np.arange(self.robots)
        self._env.restore(first, sim_state.reshape(self.robots, -1))
        seen: Array = self._env.observe()[first]
        return seen

    def follow(self, state: tuple[Array, Array], plan: Sequence[Segment]) -> tuple[Array, Array]:
        """Return state (S,) and keypoints (M, L, 3) m at the end of held latents that begin in such a state."""
        for segment in plan:
            outcome = self.hold(state[0][None], segment.latent[None], segment.steps)
            state = outcome.sim_states[0], outcome.path[0, :, -1]
        return state

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        """Hold latents (n, d) from states (n, S) for some control steps; n may exceed the number of slots."""
        parts = [
            self._hold(sim_states[first:][: self.slots], latent[first:][: self.slots], steps)
            for first in range(0, len(sim_states), self.slots)
        ]
        return Outcome(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)))

    def _broken(self) -> Array:
        """Return which simulations violate one of the limits, (N,) bool."""
        violations = self._env.violations()
        kept = np.array([name in self.limits for name in SAFETY_LIMITS[: violations.shape[1]]], dtype=bool)
        broken: Array = (violations & kept).any(axis=1)
        return broken

    def _hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        """Do the same for at most as many states as there are slots."""
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
