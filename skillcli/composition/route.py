"""A route: waypoints in order, and the cost that remains, on one robot or on several at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from skillcli import metrics
from skillcli.trajectories import Array

CAUTION = 0.5  # standard deviations over the robots that are added to their mean


def risk_adjusted(values: Array) -> Array:
    """Reduce values of M robots to their mean plus `CAUTION` standard deviations: (n, M) to (n,)."""
    number: Array = values.mean(axis=-1) + CAUTION * values.std(axis=-1)
    return number


class CostToGo(Protocol):
    """The cost from a state to one waypoint. A task supplies it if the straight distance is misleading."""

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the distance from keypoints (..., L, 3) m, achieved goal first, to a waypoint (..., 3) m, (...,) m."""

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """Return the extra way before anything can move, such as a gripper's way behind a box, (...,) m."""


class StraightDistance:
    """See `CostToGo`: the straight distance."""

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """See `CostToGo`."""
        distance: Array = np.linalg.norm(keypoints[..., 0, :] - waypoint, axis=-1)
        return distance

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """See `CostToGo`: zero."""
        return np.zeros(keypoints.shape[:-2])


STRAIGHT = StraightDistance()


@dataclass(frozen=True, eq=False)
class RouteProgress:
    """How far n paths come along a route, each on M robots."""

    next_waypoint: Array  # (n, M) index of the next waypoint at the end of the path
    arrived: Array  # (n,) the step at which all robots had met the last waypoint, 0 if they had not
    cost: Array  # (n,) m, remaining cost summed over the steps up to there


@dataclass(frozen=True, eq=False)
class Route:
    """Waypoints to pass in order; the achieved goal should stay at the last one.

    Keypoints describe a state: the achieved goal first, then what the task adds, such as a gripper beside a box.
    """

    waypoints: Array  # (W, 3) m
    tolerance: float  # m, a waypoint before the last is met within this
    to_waypoint: CostToGo = STRAIGHT
    detour_weight: float = 0.25  # cost of a metre of detour, in metres

    def follow(self, next_waypoint: Array, path: Array, within: float = 0.0) -> RouteProgress:
        """Follow paths (n, M, T+1, L, 3) m from the indices (n, M) of their next waypoints.

        Row 0 of a path belongs to the previous segment and cannot meet a waypoint. The path is over when all robots head for
        the last waypoint and their risk-adjusted distance is at most `within` m. Later steps do not count.
        """
        following, arrived = next_waypoint, np.zeros(len(path), dtype=int)
        cost: Array = np.zeros(len(path))
        last = len(self.waypoints) - 1
        for t in range(1, path.shape[2]):
            now, under_way = path[:, :, t], arrived == 0
            following = metrics.next_waypoint(following, now[..., 0, :], self.waypoints, self.tolerance, keep_last=True)
            there = (following == last).all(axis=1) & (risk_adjusted(self.final_gap(now)) <= within)
            arrived[under_way & there] = t
            cost += np.where(arrived == 0, risk_adjusted(self.cost_to_go(following, now)), 0.0)
        return RouteProgress(following, arrived, cost)

    def gap(self, next_waypoint: Array, keypoints: Array) -> Array:
        """Return keypoints (..., L, 3) m relative to the next waypoint (...,), (..., L, 3) m."""
        gap: Array = keypoints - self.waypoints[next_waypoint][..., None, :]
        return gap

    def cost_to_go(self, next_waypoint: Array, keypoints: Array) -> Array:
        """Return the cost from keypoints (..., L, 3) m: remaining length plus weighted detour, (...,) m."""
        detour = self.detour(next_waypoint, keypoints)
        cost: Array = self.remaining_length(next_waypoint, keypoints) + self.detour_weight * detour
        return cost

    def remaining_length(self, next_waypoint: Array, keypoints: Array) -> Array:
        """Return the distance to the next waypoint plus the straight way through the others, (..., L, 3) m to (...,) m."""
        to_next = self.to_waypoint.distance(keypoints, self.waypoints[next_waypoint])
        length: Array = to_next + self._length_behind[next_waypoint]
        return length

    def detour(self, next_waypoint: Array, keypoints: Array) -> Array:
        """Return the extra way before anything moves to the next waypoint, (..., L, 3) m to (...,) m."""
        return self.to_waypoint.detour(keypoints, self.waypoints[next_waypoint])

    @cached_property
    def _length_behind(self) -> Array:
        """Return the length of the route after each waypoint, (W,) m."""
        lengths = np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1)
        return np.concatenate([np.cumsum(lengths[::-1])[::-1], [0.0]])

    def final_gap(self, keypoints: Array) -> Array:
        """Return the distance of the achieved goal to the last waypoint, (..., L, 3) m to (...,) m."""
        gap: Array = np.linalg.norm(keypoints[..., 0, :] - self.waypoints[-1], axis=-1)
        return gap
