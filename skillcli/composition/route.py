"""Where a composition has to go: waypoints in order, and how much is left to do, on one robot or on several at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from skillcli import metrics
from skillcli.trajectories import Array

CAUTION = 0.5  # standard deviations over the robots that count on top of their mean


def risk_adjusted(values: Array) -> Array:
    """One number for what differs between robots, mean plus `CAUTION` standard deviations: (n, M) to (n,)."""
    number: Array = values.mean(axis=-1) + CAUTION * values.std(axis=-1)
    return number


class CostToGo(Protocol):
    """What a state has before it to one waypoint. A task supplies it where the straight distance does not say it all."""

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """From keypoints (..., L, 3) m, the judged one first, to a waypoint (..., 3) m: what is left to go, (...,) m."""

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """What has to be gone beside that before anything moves on, a gripper's way behind a box say, (...,) m."""


class StraightDistance:
    """See `CostToGo`: as the crow flies."""

    def distance(self, keypoints: Array, waypoint: Array) -> Array:
        """See `CostToGo`."""
        distance: Array = np.linalg.norm(keypoints[..., 0, :] - waypoint, axis=-1)
        return distance

    def detour(self, keypoints: Array, waypoint: Array) -> Array:
        """See `CostToGo`: none."""
        return np.zeros(keypoints.shape[:-2])


STRAIGHT = StraightDistance()


@dataclass(frozen=True, eq=False)
class RouteProgress:
    """How far n paths come, each gone by M robots."""

    next_waypoint: Array  # (n, M) index of the waypoint to be met next, at the end
    arrived: Array  # (n,) the step at which the last waypoint was met by all, 0 where it was not
    cost: Array  # (n,) m, what was left to go after each step, summed up to there


@dataclass(frozen=True, eq=False)
class Route:
    """Waypoints to be passed in order; at the last one the judged point should stay.

    Keypoints tell how things stand: the judged point first, then what the task adds, a gripper beside a box say.
    """

    waypoints: Array  # (W, 3) m
    tolerance: float  # m, a waypoint before the last is passed within this
    to_waypoint: CostToGo = STRAIGHT
    detour_weight: float = 0.25  # metres to go that a metre of detour counts for

    def follow(self, next_waypoint: Array, path: Array, within: float = 0.0) -> RouteProgress:
        """How far a path comes: (n, M) indices of the next waypoints, and (n, M, T+1, L, 3) m keypoints.

        Row 0 has been looked at before. Of the last waypoint more is asked than to be near: the path is over where all robots
        are on their way to it and come, risk adjusted, `within` that many metres of it. Nothing counts from there on.
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
        """Keypoints (..., L, 3) m as seen from the next waypoint (...,), (..., L, 3) m."""
        gap: Array = keypoints - self.waypoints[next_waypoint][..., None, :]
        return gap

    def cost_to_go(self, next_waypoint: Array, keypoints: Array) -> Array:
        """Metres to go from keypoints (..., L, 3) m: the remaining length, and the detour by its weight; (...,)."""
        detour = self.detour(next_waypoint, keypoints)
        cost: Array = self.remaining_length(next_waypoint, keypoints) + self.detour_weight * detour
        return cost

    def remaining_length(self, next_waypoint: Array, keypoints: Array) -> Array:
        """To the next waypoint, and straight on through the others, (..., L, 3) m to (...,) m."""
        to_next = self.to_waypoint.distance(keypoints, self.waypoints[next_waypoint])
        length: Array = to_next + self._length_behind[next_waypoint]
        return length

    def detour(self, next_waypoint: Array, keypoints: Array) -> Array:
        """What has to be gone before anything moves on to the next waypoint, (..., L, 3) m to (...,) m."""
        return self.to_waypoint.detour(keypoints, self.waypoints[next_waypoint])

    @cached_property
    def _length_behind(self) -> Array:
        """Length of the route behind each waypoint, (W,) m."""
        lengths = np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1)
        return np.concatenate([np.cumsum(lengths[::-1])[::-1], [0.0]])

    def final_gap(self, keypoints: Array) -> Array:
        """Distance of the judged point to the last waypoint, (..., L, 3) m to (...,) m."""
        gap: Array = np.linalg.norm(keypoints[..., 0, :] - self.waypoints[-1], axis=-1)
        return gap
