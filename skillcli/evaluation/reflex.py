"""A reflex below the plan: where the box begins to tip, the finger lets go of it before anything is planned again.

What tips a box is a finger that comes down on its rim, a few millimetres from where it was meant to pass, and pushes, presses
or drags it there. Plans do not foresee that: it hangs on millimetres that the sensors do not show. From the first degrees to a
box that falls it takes a fifth of a second, less than a segment lasts. But it shows, and a box that is let go of falls back.
"""

from __future__ import annotations

import math

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import StateEstimate
from skillcli.trajectories import Array

TIPPING = math.radians(9)  # that a box is about to lean by: in pushes that go well it hardly passes 5
STANDING = math.radians(3)  # from where it rests; below, it counts as standing
FORESIGHT = 0.1  # s ahead that its lean is foreseen, on a straight line: about what an arm needs to answer
ROOM = 0.05  # m between the middle of the finger and the box from which a new plan may begin
LEAD = 0.06  # m that the gripper is sent ahead of where it is
ASIDE = 0.7  # of the way up that it goes against the lean
LONGEST = 20  # control steps in a row: a finger that cannot get away is left to the next plan


class Reflex:
    """Lets go of a box that begins to tip.

    Args:
        env: for what estimated states suggest; its first simulation is used.
    """

    def __init__(self, env: ArmEnvironment) -> None:
        self._env, self._steps_ahead = env, FORESIGHT / env.control_period

    def reset(self, seen: StateEstimate) -> None:
        """An episode begins, with the box at rest."""
        self._rest, self._lean = seen.tilt[0], 0.0
        self._count = 0  # control steps that it has been letting go

    def action(self, seen: StateEstimate, sag: Array) -> Array | None:
        """What lets go of the box, in units of the action limit (1, J); None while it stands.

        Straight up, which frees a box that is dragged or pressed from above, and against its lean. A box that is pushed leans
        away from the finger, one that is pressed on its rim towards it: away from the box would drag that one along.

        Args:
            seen: the target as its sensors show it, at every control step.
            sag: (J,) rad, how far its joints come to rest from where they are sent.
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
        arms = self._env.arms
        way = np.array([*(-ASIDE * tilt / max(STANDING, float(np.linalg.norm(tilt)))), 1.0])
        turn = arms.turns_towards(np.tile(LEAD * way / np.linalg.norm(way), (self._env.num_envs, 1)))[0]
        # from where the arm is, not from where it was sent: that is further in the box
        target = arms.joint_position[0] - sag + turn
        action: Array = np.clip((target - arms.commanded[0]) / arms.action_limit, -1.0, 1.0)
        return action[None]
