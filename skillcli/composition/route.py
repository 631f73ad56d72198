"""Where a composition has to go: waypoints in order, and how much is left to do, on one robot or on several at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skillcli.tasks.push.geometry import place_behind, share
from skillcli.trajectories import Array

CAUTION = 0.5  # standard deviations over the robots that count on top of their mean


def cautious(values: Array) -> Array:
    """One number for what differs between robots, mean plus `CAUTION` standard deviations: (n, M) to (n,)."""
    number: Array = values.mean(axis=-1) + CAUTION * values.std(axis=-1)
    return number


@dataclass(frozen=True, eq=False)
class Walk:
    """What n paths got done, each walked by M robots."""

    due: Array  # (n, M) the waypoint that is due at the end
    arrived: Array  # (n,) the step at which the last waypoint was met by all, 0 where it was not
    cost: Array  # (n,) m, what was left to go after each step, summed up to there


@dataclass(frozen=True, eq=False)
class Route:
    """Waypoints to be passed in order; at the last one the judged point should stay.

    Where there is a box, the first two landmarks are the box and the gripper, which is led to where it can push the box
    straight at the waypoint that is due: without that a box that nobody touches looks the same whatever the gripper does.
    """

    waypoints: Array  # (W, 3) m
    tolerance: float  # m, a waypoint before the last is passed within this
    half_edges: tuple[float, float] = (0.0, 0.0)  # m, half of the edges of the box along x and y, 0 where there is none
    approach: float = 0.25  # metres to go that a metre between gripper and that place counts for

    def follow(self, due: Array, path: Array, within: float = 0.0) -> Walk:
        """What a path gets done: (n, M) indices of the waypoints that are due, and (n, M, T+1, L, 3) m landmarks.

        Row 0 of the path has been looked at before. The last waypoint stays due; the path is over where all robots have it
        due and come, cautiously counted, `within` that many metres of it. Nothing counts from there on.
        """
        due, arrived = due.copy(), np.zeros(len(path), dtype=int)
        cost: Array = np.zeros(len(path))
        last = len(self.waypoints) - 1
        for t in range(1, path.shape[2]):
            now, under_way = path[:, :, t], arrived == 0
            gap = np.linalg.norm(now[..., 0, :] - self.waypoints[due], axis=-1)
            due += under_way[:, None] & (gap <= self.tolerance) & (due < last)
            there = (due == last).all(axis=1) & (cautious(self.final_gap(now)) <= within)
            arrived[under_way & there] = t
            cost += np.where(arrived == 0, cautious(self.left(due, now)), 0.0)
        return Walk(due, arrived, cost)

    def gap(self, due: Array, points: Array) -> Array:
        """Landmarks (..., L, 3) m as seen from the waypoint (...,) that is due, (..., L, 3) m."""
        gap: Array = points - self.waypoints[due][..., None, :]
        return gap

    def left(self, due: Array, points: Array) -> Array:
        """Metres to go for landmarks (..., L, 3) m: to the waypoint due, on through the others, and the approach; (...,).

        Without a box there is no approach, whatever the landmarks behind the first are.
        """
        left = self.way(due, points)
        if any(self.half_edges):
            left += self.approach * self.detour(due, points)
        return left

    def way(self, due: Array, points: Array) -> Array:
        """From the judged point straight to the waypoint that is due and on through the others, (..., L, 3) m to (...,) m."""
        way: Array = np.linalg.norm(points[..., 0, :] - self.waypoints[due], axis=-1) + self._legs_behind[due]
        return way

    @cached_property
    def _legs_behind(self) -> Array:
        """Length of the route behind each waypoint, (W,) m."""
        legs = np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1)
        return np.concatenate([np.cumsum(legs[::-1])[::-1], [0.0]])

    def final_gap(self, points: Array) -> Array:
        """Distance of the judged point to the last waypoint, (..., L, 3) m to (...,) m."""
        gap: Array = np.linalg.norm(points[..., 0, :] - self.waypoints[-1], axis=-1)
        return gap

    def detour(self, due: Array, points: Array) -> Array:
        """From the gripper to where it can push the box straight at the waypoint, seen from above, (...,) m.

        Counts less and less within `pushing.FADE` of the waypoint.
        """
        box, gripper, goal = points[..., 0, :2], points[..., 1, :2], self.waypoints[due, :2]
        way = np.linalg.norm(gripper - place_behind(box, goal, np.array(self.half_edges)), axis=-1)
        detour: Array = share(np.linalg.norm(goal - box, axis=-1)) * way
        return detour
