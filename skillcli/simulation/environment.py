"""The interface of every environment, and the result of one control step."""

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
    "NO_SKILL", "SAFETY_LIMITS", "Array", "Environment", "ObservationTerm", "RewardTerms", "StateEstimate", "Step", "signed",
    "total_reward",
]  # fmt: skip


NO_SKILL = -1  # of an episode in which a whole task is done: it begins where the task does, and its goal comes afterwards


class Step(NamedTuple):
    """The result of one control step of all N simulations."""

    observation: NDArray[Any]  # (N, o) float32
    reward: NDArray[Any]  # (N,) the reward of the task
    terminated: NDArray[Any]  # (N,) bool: failed, for example an unstable simulation
    truncated: NDArray[Any]  # (N,) bool: out of time
    reward_terms: Mapping[str, NDArray[Any]]  # (N,) each, by name: the terms that add up to the reward, where nothing failed


class ObservationTerm(NamedTuple):
    """One quantity of an observation."""

    name: str
    unit: str
    size: int  # number of values
    frame: str = ""  # what it is measured from, for whoever drives a real arm; empty: the task does not say


class RewardTerms(NamedTuple):
    """Rewards and costs of a state by name, (N,) each and weighted; the reward is the sum of rewards less the costs."""

    earned: dict[str, NDArray[Any]]
    costs: dict[str, NDArray[Any]]


def signed(terms: RewardTerms) -> dict[str, NDArray[Any]]:
    """Return all terms by name, costs negative, (N,) each."""
    return {**terms.earned, **{name: -cost for name, cost in terms.costs.items()}}


def total_reward(terms: RewardTerms) -> NDArray[Any]:
    """Add up the terms to the reward, (N,)."""
    earned = functools.reduce(np.add, terms.earned.values())
    return np.subtract(earned, functools.reduce(np.add, terms.costs.values())) if terms.costs else earned


class StateEstimate(NamedTuple):
    """The state of N simulations, estimated from their sensors."""

    state: NDArray[Any]  # (N, v), opaque: for `Environment.set_estimated_state`
    achieved_goal: NDArray[Any]  # (N, 3) m
    tilt: NDArray[Any]  # (N, 2) direction of a pushed object's tilt, length the sine of its angle; 0 without an object


class Environment(Protocol):
    """N simulations of one task. The observation contains neither goal nor skill; the reward depends on the goal."""

    robot: Robot  # the simulated arm; a task without an engine ignores it
    joints: int  # joints of that arm
    num_envs: int
    horizon: int  # control steps in an episode
    control_period: float  # s
    observation_size: int
    action_size: int
    privileged_size: int
    goals: Array  # (K, 3) m, the goal of each skill
    tolerance: float  # m
    desired_goal: Array  # (N, 3) m, the goal in the reward
    applied: Array  # (N, a) how far the last step moved the commanded targets, after all clipping, rad or m
    unstable: Array  # (N,) bool: whether the last step ended in a state that is not finite or far out of range

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Names of the terms of the reward."""

    def reset(self, ids: Array, skill: Array) -> None:
        """Put these simulations at the start, with the goals of these skills (n,) or `NO_SKILL`, and their clocks at zero.

        Some tasks have another start for each skill.
        """

    def mix_goals(self, ids: Array, weights: Array) -> None:
        """Ask of these simulations, after a reset, the mixture of the skills' goals with weights (n, K) that add to one.

        Where goals are places that is their weighted mean.
        """

    def observe(self) -> Array:
        """Return the observations, (N, o) float32."""

    def privileged(self) -> Array:
        """Return observations for the value function only, (N, p) float32; p may be 0."""

    def step(self, action: Array) -> Step:
        """Apply actions (N, a), in units of the action limit and clipped to ±1, for one control step."""

    def set_active(self, ids: Array | None) -> None:
        """Simulate only these; None for all. The others may keep their state, which costs less."""

    def achieved_goal(self) -> Array:
        """Return the position that is compared with the goal, (N, 3) m: the gripper, or a pushed object."""

    def keypoints(self) -> Array:
        """Return the points that describe a state to a planner, (N, L, 3) m: the achieved goal first, then a gripper."""

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """Start episodes of these skills from saved states, with their clocks at zero."""

    def save(self, ids: Array) -> Array:
        """Return whole states of these simulations, (n, S)."""

    def restore(self, ids: Array, sim_states: Array) -> None:
        """Put saved states into these simulations."""

    def estimate_state(self) -> StateEstimate:
        """Return the state that the sensors show now, with their noise, at the time of the last observation."""

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """Put simulations (n,) into estimated states (n, v), perhaps of another robot.

        The joints of that robot may rest `sag` (n, 7) rad off their commands; from now on these simulations' joints do too.
        """

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """Give every simulation parameters of its own, before a reset; see `skillcli.config.randomization.PARAMETERS`.

        Args:
            parameters: (N,) or (N, n) by name; absent ones are nominal.
            rng: draws noise, drift, late commands and external forces during the episode. One for all simulations, or one
                each.
        """

    def violations(self) -> Array:
        """Return which of the first K `SAFETY_LIMITS` each state violates, (N, K) bool; K is 0 without limits."""

    def recorded_state(self) -> dict[str, Array]:
        """Return the recorded fields of the present state, by their names in `Trajectories`, each (N, ...)."""
