"""A reflex below the plan: when the box begins to tip, the finger lets go of it before a new plan is made.

A box tips when the finger comes down on its rim, a few millimetres beside its path, and pushes, presses or drags it. A
planner cannot foresee this: it depends on millimetres below the sensors' accuracy. From the first degrees to a fall takes a
fifth of a second, less than a segment. But the tilt is measurable, and a box that is released in time falls back.
"""

from __future__ import annotations

import math

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import StateEstimate
from skillcli.trajectories import Array

TIPPING = math.radians(9)  # predicted tilt that triggers the reflex; in a good push it rarely exceeds 5°
STANDING = math.radians(3)  # tilt from the resting orientation below which the box counts as upright
FORESIGHT = 0.1  # s, horizon of the linear prediction: about the reaction time of an arm
ROOM = 0.05  # m, clearance between the middle of the finger and the box at which a new plan may begin
LEAD = 0.06  # m, lead of the commanded gripper position over the measured one
ASIDE = 0.7  # sideways speed against the tilt, per upward speed
LONGEST = 20  # control steps in a row; if the finger cannot get away by then, the planner decides


class Reflex:
    """Releases a box that begins to tip.

    Args:
        env: simulates estimated states; only its first simulation is used.
    """

    def __init__(self, env: ArmEnvironment) -> None:
        self._env, self._steps_ahead = env, FORESIGHT / env.control_period

    def reset(self, seen: StateEstimate) -> None:
        """Begin an episode with the box at rest."""
        self._rest, self._lean = seen.tilt[0], 0.0
        self._count = 0  # control steps since the reflex began

    def action(self, seen: StateEstimate, sag: Array) -> Array | None:
        """Return the action that releases the box, in units of the action limit (1, J); None while it is upright.

        The finger moves straight up, which frees a box that it drags or presses, and sideways against the tilt. A pushed box
        tilts away from the finger, a box pressed on its rim tilts towards it: moving away from the box would drag it along.

        Args:
            seen: estimated state of the target, at every control step.
            sag: (J,) rad, resting offset of its joints from their commands.
        """
        tilt = seen.tilt[0] - self._rest
        before, self._lean = self._lean, math.asin(min(1.0, float(np.linalg.norm(tilt))))
        foreseen = self._lean + self._steps_ahead * (self._lean - before)
        if self._count == 0 and not (self._lean > STANDING and foreseen > TIPPING):
            return None
        self._env.set_estimated_state(np.array([0]), seen.state, sag[None])
        free = self._lean < STANDING and float(self._env.room()[0]) >= ROOM
        if free or self._count == LONGEST:
            self._count = 0
            return None
        self._count += 1
        way = np.array([*(-ASIDE * tilt / max(STANDING, float(np.linalg.norm(tilt)))), 1.0])
        return leading(self._env, way / np.linalg.norm(way), sag)


def leading(env: ArmEnvironment, way: Array, sag: Array) -> Array:
    """Return the action that leads the first simulation's gripper in a direction (3,), in units of the action limit (1, J)."""
    arms = env.arms
    turn = arms.turns_towards(np.tile(LEAD * way, (env.num_envs, 1)))[0]
    # start from the measured position: the commanded one may lie deeper in the box
    target = arms.joint_position[0] - sag + turn
    action: Array = np.clip((target - arms.commanded[0]) / arms.action_limit, -1.0, 1.0)
    return action[None]
