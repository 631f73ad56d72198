"""What of a session is shown: the pose that is drawn, and how things stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli.trajectories import Array


@dataclass(frozen=True)
class Pose:
    """The state that is drawn."""

    achieved_goal: Array  # (3,) m
    joint_position: Array | None = None  # (J,) rad
    object_poses: Array | None = None  # (7K,) m and w x y z of K objects
    finger_position: Array | None = None  # (2,) m, how far each finger of a hand is open


@dataclass(frozen=True)
class Status:
    """What is shown beside the arm."""

    running: bool
    planning: str  # progress of the plan being made; "" if there is none
    recording: float | None  # s recorded so far; None: nothing is recorded
    seconds: float  # simulated since the start
    skill: str  # what is held: a skill by name, "latent", or an entry of the plan
    distance: float  # m, of the achieved goal from the goal
    tolerance: float  # m
    violated: tuple[str, ...]  # limits that the present state violates
    violations: tuple[str, ...]  # limits that were violated since the start
    said: str  # the last message

    @property
    def success(self) -> bool:
        """Return whether the goal is reached."""
        return self.distance <= self.tolerance


def between(before: Pose, after: Pose, share: float) -> Pose:
    """Return the pose at a share of the way; a quaternion along the chord, which over one step is as good as the arc."""
    if share >= 1.0 or before is after:
        return after

    def mixed(a: Array | None, b: Array | None) -> Array | None:
        return None if a is None or b is None else a + share * (b - a)

    boxes = mixed(before.object_poses, after.object_poses)
    if boxes is not None and before.object_poses is not None and after.object_poses is not None:
        first, second = (each.reshape(-1, 7)[:, 3:] for each in (before.object_poses, after.object_poses))
        alike = np.copysign(1.0, (first * second).sum(axis=1, keepdims=True))
        turn = first + share * (alike * second - first)
        boxes.reshape(-1, 7)[:, 3:] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    place = before.achieved_goal + share * (after.achieved_goal - before.achieved_goal)
    fingers = mixed(before.finger_position, after.finger_position)
    return Pose(place, mixed(before.joint_position, after.joint_position), boxes, fingers)
