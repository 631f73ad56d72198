"""The way back to the start, from where an episode gets no nearer: up, and then joint by joint.

Skills are trained from the start of an episode. A finger that stands on the box, hangs over it or is on its wrong side is where
they seldom were, and what they do there moves it little. From the start, with the box where it is now, they push again.
"""

from __future__ import annotations

import math

import numpy as np

from skillcli.evaluation.reflex import leading
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import StateEstimate
from skillcli.trajectories import Array

UP = np.array([0.0, 0.0, 1.0])
HIGH = 0.02  # m below its start, the gripper is high enough to go sideways
BACK = 0.02  # rad of each joint's command from its start, within which it is back
LONGEST = 60  # control steps at full speed; an arm that is not back by then is blocked


class WayBack:
    """Brings the arm back to its start.

    Args:
        env: simulates estimated states, at its start now; only its first simulation is used.
    """

    def __init__(self, env: ArmEnvironment) -> None:
        self._env = env
        self._start, self._height = env.arms.commanded[0].copy(), float(env.arms.gripper_position[0, 2])
        self._left, self._high = 0, False

    def begin(self, share: float = 1.0) -> None:
        """Begin a way back, of an arm that carries out this share of every action."""
        self._left, self._high = math.ceil(LONGEST / share), False

    def action(self, seen: StateEstimate, sag: Array) -> Array | None:
        """Return the action that leads back, in units of the action limit (1, J); None at the start, or if it is blocked.

        Args:
            seen: estimated state of the target, at every control step.
            sag: (J,) rad, resting offset of its joints from their commands.
        """
        self._env.set_estimated_state(np.array([0]), seen.state, sag[None])
        arms = self._env.arms
        self._high = self._high or bool(arms.gripper_position[0, 2] >= self._height - HIGH)
        way: Array = self._start - arms.commanded[0]
        if self._left == 0 or (self._high and float(np.abs(way).max()) <= BACK):
            return None
        self._left -= 1
        if not self._high:
            return leading(self._env, UP, sag)
        # every joint takes the same time, so that the hand goes the straight way in joint space
        action: Array = way / max(arms.action_limit, float(np.abs(way).max()))
        return action[None]
