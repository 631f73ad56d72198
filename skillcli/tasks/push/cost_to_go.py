"""The remaining cost that planners use while a box is pushed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli.tasks.push.geometry import Array, place_behind, share
from skillcli.tasks.push.settings import TURN


@dataclass(frozen=True)
class BoxCostToGo:
    """The way of the box, and the detour of the gripper to the place behind the box.

    Without the detour, all states with an untouched box look the same. Keypoints are box and gripper. Where
    goals name a turn, the third coordinate of the box stands for its own.
    """

    half_edges: tuple[float, float]  # m, half of the edges of the box along x and y

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the distance from the box (..., 0, 3) m to a waypoint (..., 3) m, (...,) m."""
        distance: Array = np.linalg.norm(keypoints[..., 0, :] - waypoint, axis=-1)
        return distance

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the distance from the gripper (..., 1, 3) m to its place behind the box, seen from above, (...,) m.

        It fades within `geometry.FADE` of the waypoint.
        """
        box, gripper, goal = keypoints[..., 0, :2], keypoints[..., 1, :2], waypoint[..., :2]
        turn = (waypoint[..., 2] - keypoints[..., 0, 2]) / TURN
        way = np.linalg.norm(gripper - place_behind(box, goal, np.array(self.half_edges), turn), axis=-1)
        detour: Array = share(np.linalg.norm(goal - box, axis=-1)) * way
        return detour
