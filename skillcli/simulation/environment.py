"""What every environment offers, and what one control step returns."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skillcli.robots.robot import Robot
from skillcli.simulation.chance import Rng
from skillcli.trajectories import SAFETY_LIMITS, Array

__all__ = [
    "SAFETY_LIMITS", "Array", "Environment", "ObservationTerm", "RewardTerms", "StateEstimate", "Step", "signed",
    "total_reward",
]  # fmt: skip


class Step(NamedTuple):
    """The outcome of one control step of all N simulations."""

    observation: NDArray[Any]  # (N, o) float32
    reward: NDArray[Any]  # (N,) the task's own reward
    terminated: NDArray[Any]  # (N,) bool: failed for good, an unstable simulation say
    truncated: NDArray[Any]  # (N,) bool: out of time
    reward_terms: Mapping[str, NDArray[Any]]  # (N,) each, by name: what the reward is the sum of, where nothing failed


class ObservationTerm(NamedTuple):
    """One quantity of an observation."""

    name: str
    unit: str
    size: int  # numbers


class RewardTerms(NamedTuple):
    """What a state earns and what it costs, by name, each (N,) and weighted; the reward is what is earned less the costs."""

    earned: dict[str, NDArray[Any]]
    costs: dict[str, NDArray[Any]]


def signed(terms: RewardTerms) -> dict[str, NDArray[Any]]:
    """All terms by name, costs below zero, (N,) each."""
    return {**terms.earned, **{name: -cost for name, cost in terms.costs.items()}}


def total_reward(terms: RewardTerms) -> NDArray[Any]:
    """The reward that the terms add up to, (N,)."""
    earned = functools.reduce(np.add, terms.earned.values())
    return np.subtract(earned, functools.reduce(np.add, terms.costs.values())) if terms.costs else earned


class StateEstimate(NamedTuple):
    """What the sensors of N simulations tell of their state."""

    state: NDArray[Any]  # (N, v), opaque: `Environment.set_estimated_state` understands it
    achieved_goal: NDArray[Any]  # (N, 3) m, where the judged point seems to be
    tilt: NDArray[Any]  # (N, 2) which way what is pushed leans, in length the sine of how far; 0 where nothing can lean


class Environment(Protocol):
    """N simulations of one task. The observation holds neither goal nor skill; the reward knows the goal."""

    robot: Robot  # whose arm is simulated, where there is one
    joints: int  # of that arm
    num_envs: int
    horizon: int  # control steps in an episode
    control_period: float  # s
    observation_size: int
    action_size: int
    privileged_size: int
    goals: Array  # (K, 3) m, the goal of each skill
    tolerance: float  # m
    desired_goal: Array  # (N, 3) m, the goal that the reward looks at
    applied: Array  # (N, a) how far the last step moved the commanded targets, after all clipping, rad or m
    unstable: Array  # (N,) bool: whose last step ended in a state that is not finite or not of this world

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Of the terms of the reward."""

    def reset(self, ids: Array, skill: Array) -> None:
        """Put these simulations at the start, with the goals of these skills (n,), and their clocks at zero."""

    def observe(self) -> Array:
        """(N, o) float32."""

    def privileged(self) -> Array:
        """What a value function may know and a policy may not, (N, p) float32; p may be 0."""

    def step(self, action: Array) -> Step:
        """Apply actions (N, a), in units of the action limit and clipped to ±1, for one control step."""

    def set_active(self, ids: Array | None) -> None:
        """Let only these simulations move, all where None; the others may stay as they are, and cost less."""

    def achieved_goal(self) -> Array:
        """Where the judged point of each simulation is, (N, 3) m."""

    def keypoints(self) -> Array:
        """Points that tell a planner how things stand, (N, L, 3) m: the judged one first, then the gripper beside a box."""

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """Begin episodes of these skills from saved states, their clocks at zero."""

    def save(self, ids: Array) -> Array:
        """Whole states of these simulations, (n, S)."""

    def restore(self, ids: Array, sim_states: Array) -> None:
        """Put saved states into these slots."""

    def estimate_state(self) -> StateEstimate:
        """The state as the sensors show it now, noise and all, behind the last observation."""

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """Put simulations (n,) into the state that sightings (n, v) suggest, those of another robot perhaps.

        Its joints may come to rest off their targets, by `sag` (n, 7) rad; so do those of these simulations from now on.
        """

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """Turn every simulation into a robot of its own, before a reset; see `skillcli.config.randomization.PARAMETERS`.

        Args:
            parameters: (N,) or (N, n) by name; what is absent is nominal.
            rng: of all that goes on by chance while the episode runs: noise, drift, late commands, knocks. One for all
                simulations, or one for each.
        """

    def violations(self) -> Array:
        """Which of the first K `SAFETY_LIMITS` the present state breaks, (N, K) bool; K is 0 where there are no limits."""

    def recorded_state(self) -> dict[str, Array]:
        """What a recording keeps of the present moment, by the names of `Trajectories`, each (N, ...)."""
