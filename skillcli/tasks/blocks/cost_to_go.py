"""The remaining cost that planners use while a block is grasped, carried and put down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli.trajectories import Array

BESIDE = 0.01  # m from the goal, seen from above, within which a block needs no more carrying


@dataclass(frozen=True)
class BlockCostToGo:
    """The way of the block up, over and down, and the detour of the gripper to the block.

    The straight way would make a lift look like a step back. Keypoints are the achieved goal, which is higher than the block
    by what the fingers have yet to open, then gripper and block.
    """

    height: float  # m, of the middle of a block that is carried

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the way of the block from (..., 0, 3) m to a waypoint (..., 3) m, (...,) m; the straight one near its end."""
        place = keypoints[..., 0, :]
        over = np.linalg.norm((place - waypoint)[..., :2], axis=-1)
        up, down = (np.maximum(0.0, self.height - each[..., 2]) for each in (place, waypoint))
        way: Array = np.where(over > BESIDE, up + over + down, np.linalg.norm(place - waypoint, axis=-1))
        return way

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the distance of the gripper from a block that is not at its waypoint, (...,) m."""
        gripper, block = keypoints[..., 1, :], keypoints[..., 2, :]
        away = np.linalg.norm(block - waypoint, axis=-1) > BESIDE
        detour: Array = away * np.linalg.norm(gripper - block, axis=-1)
        return detour
