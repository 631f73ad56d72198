"""Identify a target from its motion: its latency, and how far its joints rest from their commanded angles.

Both are estimated from finished segments. The same increments are sent, from the same estimated state, to simulated robots
with several latencies; the one with the smallest error, joint by joint, is the most likely. An arm that does not carry its
own weight, or a servo that is stuck, rests beside its command: this offset remains when the lag has died away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.tasks.world import World
from skillcli.trajectories import Array

LATENCY_CANDIDATES = np.array([0.0, 0.025, 0.05, 0.075, 0.1, 0.15])  # s, latencies to compare
SETTLING = 0.1  # s, time constant of a servo: damping over stiffness
DOUBT = 0.3  # settled control steps: weight of the initial guess, so that the first data count half
KEPT = 0.7  # decay of the evidence from one segment to the next: the offset depends on the posture
SILENCE = 0.002**2  # rad², per control step: noise floor; no joint is expected to follow better


class Identification:
    """What is known of one target; until the first update it is the simulated robot.

    Args:
        world: the task and robot of the source. Without an engine there is no latency, and nothing to identify.
    """

    def __init__(self, world: World) -> None:
        self._period, self._joints = world.task.control_period, world.joints
        self._robots: ArmEnvironment | None = None
        if world.spec.uses_robot:
            robots = SampledRobots({"latency": LATENCY_CANDIDATES}, len(LATENCY_CANDIDATES)).make_env(world, 1)
            assert isinstance(robots, ArmEnvironment)
            self._robots, self._limit = robots, world.action_scale
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next target is another robot."""
        self.latency = 0.0  # s
        self.sag = np.zeros(self._joints)  # rad
        self._unexplained = np.zeros((len(LATENCY_CANDIDATES), self._joints))  # rad², summed over the steps
        self._steps, self._weight = 0, DOUBT

    def update(self, state: Array, applied: Sequence[Array], measured: Sequence[Array]) -> None:
        """Learn from a finished segment.

        Args:
            state: (1, v) estimated state before the first step.
            applied: increments (J,) rad of each step.
            measured: joint angles (J,) rad after each step.
        """
        if self._robots is None or not applied:
            return
        settled = 1 - np.exp(-self._period * np.arange(1, len(applied) + 1) / SETTLING)[:, None]
        weight = float(np.square(settled).sum())
        off = np.array(measured) - self._replay(state, applied, np.tile(self.sag, (len(LATENCY_CANDIDATES), 1)))
        further = (settled * off).sum(axis=1) / weight  # (R, J) least squares fit of an error that grows as the servo settles
        most = self._robots.arms.largest_sag
        off = np.array(measured) - self._replay(state, applied, np.clip(self.sag + further, -most, most))
        self._unexplained += np.square(off).sum(axis=1)
        self._steps += len(applied)
        # one noise level per joint; else a joint that no latency explains, such as a stuck one, would decide alone
        likeliest = int(np.log(self._unexplained + SILENCE * self._steps).sum(axis=1).argmin())
        self.latency = float(LATENCY_CANDIDATES[likeliest])
        self._weight = KEPT * self._weight + weight
        self.sag = np.clip(self.sag + weight / self._weight * further[likeliest], -most, most)

    def _replay(self, state: Array, applied: Sequence[Array], sag: Array) -> Array:
        """Simulate these increments at each latency with offsets `sag` (R, J) rad; returns joint angles (R, T, J) rad."""
        assert self._robots is not None
        num_envs = len(LATENCY_CANDIDATES)
        self._robots.set_estimated_state(np.arange(num_envs), np.repeat(state, num_envs, axis=0), sag)
        steps = (self._robots.step(np.tile(increment / self._limit, (num_envs, 1))) for increment in applied)
        return np.stack([step.observation[:, : self._joints] for step in steps], axis=1)
