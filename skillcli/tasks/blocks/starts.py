"""Postures in which skills begin: the gripper over places of the table, at some heights, pointing down."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.robot import Robot
from skillcli.trajectories import Array

SPREAD = 0.15  # m to all sides of the nominal start of the block
CELLS = 4  # between the postures of a row; between them joint angles are interpolated, which costs some millimetres


class Postures:
    """Joint angles with the gripper over a square of the table, at some heights.

    Args:
        middle: of the square, (2,) m.
        heights: (H,) m, of the gripper.
        angles: (H, CELLS + 1, CELLS + 1, J) rad, by height, x and y.
    """

    def __init__(self, middle: Array, heights: tuple[float, ...], angles: Array) -> None:
        self.middle, self.heights, self._angles = middle, heights, angles

    def at(self, place: Array, level: Array) -> Array:
        """Return joint angles with the gripper at places (n, 2) m, at the heights of these indices (n,), (n, J) rad."""
        cell = np.clip((place - self.middle + SPREAD) / (2 * SPREAD) * CELLS, 0.0, CELLS)
        low = np.minimum(cell.astype(int), CELLS - 1)
        (x, y), (right, up) = low.T, (cell - low).T[:, :, None]
        near = (1 - right) * self._angles[level, x, y] + right * self._angles[level, x + 1, y]
        far = (1 - right) * self._angles[level, x, y + 1] + right * self._angles[level, x + 1, y + 1]
        angles: Array = (1 - up) * near + up * far
        return angles


@lru_cache(maxsize=8)
def postures(robot: Robot, start: tuple[float, ...], middle: tuple[float, float], heights: tuple[float, ...]) -> Postures:
    """Find postures near a start (n,) rad, with the fingers where the arm has them.

    Raises:
        UsageError: the arm does not reach one of the places.
    """
    kinematics = Kinematics(robot)
    steps = np.linspace(-SPREAD, SPREAD, CELLS + 1)
    found = np.zeros((len(heights), CELLS + 1, CELLS + 1, len(start)))
    for level, height in enumerate(heights):
        for i, x in enumerate(steps):
            for j, y in enumerate(steps):
                place = np.array([middle[0] + x, middle[1] + y, height])
                posture = kinematics.solve(place, np.array(start), down=True)
                if posture is None:
                    raise UsageError(
                        f"the hand of {robot.name} does not get to ({place[0]:g}, {place[1]:g}, {place[2]:g}) m",
                        "move task.block_start, or the start",
                    )
                found[level, i, j] = posture.angles
    return Postures(np.array(middle), heights, found)
