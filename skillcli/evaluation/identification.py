"""How a target obeys, told from how it moved: how late, and how far its joints come to rest from where they are sent.

Both are told from segments that are over. The same increments are sent, from the same sighting, to robots of several
latenesses; what they leave unexplained, joint by joint, says which is the likeliest. An arm that does not carry its own
weight, or whose servo is stuck, rests beside its targets: that is seen as what remains when a lag has died away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.tasks.world import World
from skillcli.trajectories import Array

LATENCY_CANDIDATES = np.array([0.0, 0.025, 0.05, 0.075, 0.1, 0.15])  # s, told apart
SETTLING = 0.1  # s, in which a servo comes to rest to 1/e: damping over stiffness
DOUBT = 0.3  # settled control steps that must be seen for what they tell first to count half
KEPT = 0.7  # of what is known, from one segment to the next: the arm has moved on
SILENCE = 0.002**2  # rad², per control step: what no joint is expected to do better


class Identification:
    """What is known of one target, the source's until something was seen.

    Args:
        world: of the source; where no engine simulates the task, it obeys at once, and nothing is to be told.
    """

    def __init__(self, world: World) -> None:
        self._period, self._joints = world.task.control_period, world.joints
        self._robots: ArmEnvironment | None = None
        if world.spec.uses_robot:
            robots = SampledRobots({"latency": LATENCY_CANDIDATES}, len(LATENCY_CANDIDATES)).make_env(world, 1)
            assert isinstance(robots, ArmEnvironment)
            self._robots, self._limit = robots, world.task.action_scale
        self.reset()

    def reset(self) -> None:
        """Forget what was known: another target stands there."""
        self.latency = 0.0  # s
        self.sag = np.zeros(self._joints)  # rad
        self._unexplained = np.zeros((len(LATENCY_CANDIDATES), self._joints))  # rad², summed over the steps
        self._steps, self._weight = 0, DOUBT

    def update(self, state: Array, applied: Sequence[Array], measured: Sequence[Array]) -> None:
        """Take account of a segment that is over.

        Args:
            state: (1, v) sighting before the first step.
            applied: increments (J,) rad of each step.
            measured: joint angles (J,) rad behind each step.
        """
        if self._robots is None or not applied:
            return
        settled = 1 - np.exp(-self._period * np.arange(1, len(applied) + 1) / SETTLING)[:, None]
        weight = float(np.square(settled).sum())
        off = np.array(measured) - self._replay(state, applied, np.tile(self.sag, (len(LATENCY_CANDIDATES), 1)))
        further = (settled * off).sum(axis=1) / weight  # (R, J) least squares of what grows as a servo settles
        most = self._robots.arms.largest_sag
        off = np.array(measured) - self._replay(state, applied, np.clip(self.sag + further, -most, most))
        self._unexplained += np.square(off).sum(axis=1)
        self._steps += len(applied)
        # each joint with a noise of its own, else one that no lateness explains, a stuck one say, would decide
        likeliest = int(np.log(self._unexplained + SILENCE * self._steps).sum(axis=1).argmin())
        self.latency = float(LATENCY_CANDIDATES[likeliest])
        self._weight = KEPT * self._weight + weight
        self.sag = np.clip(self.sag + weight / self._weight * further[likeliest], -most, most)

    def _replay(self, state: Array, applied: Sequence[Array], sag: Array) -> Array:
        """Joint angles of robots of each lateness with `sag` (R, J) that are sent these increments, (R, T, J) rad."""
        assert self._robots is not None
        num_envs = len(LATENCY_CANDIDATES)
        self._robots.set_estimated_state(np.arange(num_envs), np.repeat(state, num_envs, axis=0), sag)
        steps = (self._robots.step(np.tile(increment / self._limit, (num_envs, 1))) for increment in applied)
        return np.stack([step.observation[:, : self._joints] for step in steps], axis=1)
