"""Find a start for an arm: gripper down over a place, with other places within reach without a collision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.trajectories import Array

FARTHEST_TRAVEL = 1.5  # rad, of a joint from the start to a place: about half of what an episode allows
POINTS_DOWN = 0.95  # cosine of the angle between the gripper and straight down, of a gripper that points down
TURNED = 0.1  # m of height that outweigh one rad of mean rotation from home
_DIGITS = 4  # of the angles of a start, rad


def find_start(
    kinematics: Kinematics,
    middle: Array,
    places: Array,
    given: Sequence[float] | None,
    down: float | None = None,
    near: Sequence[float] | None = None,
) -> tuple[float, ...] | None:
    """Find a start from which all places are within reach without a collision; None if there is none.

    Args:
        kinematics: of the arm.
        middle: of the gripper at the start, pointing down as far as the arm can, (3,) m.
        places: to be within reach, (P, 3) m.
        given: a start that is only checked, (n,) rad.
        near: a start for a place nearby, (n,) rad; only one like it is accepted.
        down: least cosine between the gripper and straight down at all places; None if any direction will do.
    """
    room = kinematics.robot.workspace
    if np.linalg.norm(places - room.shoulder, axis=1).max() > room.reach:
        return None  # no need to search
    if given is not None:
        return _judged(kinematics, np.array(given, dtype=float), places, down)
    if near is not None:
        alike = kinematics.solve(middle, np.array(near), down=True)
        return None if alike is None else _judged(kinematics, np.round(alike.angles, _DIGITS), places, down)
    home = np.array(kinematics.robot.home)
    postures = list(kinematics.postures(middle, home, down=True))
    best = max((posture.down for posture in postures), default=0.0)
    good = [posture for posture in postures if posture.down >= min(best - 0.02, POINTS_DOWN)]
    # Elbow up, so that links stay off the table, and joints turned no farther than needed.
    good.sort(key=lambda posture: TURNED * float(np.abs(posture.angles - home).mean()) - kinematics.height(posture.angles))
    judged = (_judged(kinematics, np.round(posture.angles, _DIGITS), places, down) for posture in good)
    return next((start for start in judged if start is not None), None)


def _judged(kinematics: Kinematics, start: Array, places: Array, down: float | None) -> tuple[float, ...] | None:
    if kinematics.collides(start):
        return None
    here, _ = kinematics.gripper(start)
    for place in sorted(places, key=lambda each: -float(np.linalg.norm(each - here))):  # the farthest fails first
        posture = kinematics.solve(place, start, down=down is not None)
        if posture is None or not kinematics.passes(start, posture.angles) or posture.down < (-1 if down is None else down):
            return None
        if np.abs(posture.angles - start).max() > FARTHEST_TRAVEL:
            return None
    return tuple(float(angle) + 0.0 for angle in start)
