"""The one format of recorded motion: `E` episodes of at most `T` control steps, on one clock.

Every stage writes it and every figure reads it. Row 0 along the time axis is the state after reset; row `length[e]` is the
last state of episode `e`, and later rows repeat that state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray

Array = NDArray[Any]

# Safety limits, by column of `violations` and `violated`; without a box or a hand there are no columns of its limits.
SAFETY_LIMITS = ("joint_range", "joint_speed", "table_clearance", "box_pressed", "box_tipped", "hand_force")

# Dimensions and unit of every field of `Trajectories`, as the store keeps them.
AXES = {
    "time": ("step+1", "s"),
    "latent": ("episode,step,latent", ""),
    "skill": ("episode,step", ""),
    "action": ("episode,step,action", "rad or m"),
    "reward": ("episode,step", ""),
    "target": ("episode,xyz", "m"),
    "success": ("episode", ""),
    "length": ("episode", "step"),
    "joint_position": ("episode,step+1,joint", "rad"),
    "gripper_position": ("episode,step+1,xyz", "m"),
    "object_pose": ("episode,step+1,pose", "m"),
    "other_poses": ("episode,step+1,other", "m"),
    "finger_position": ("episode,step+1,finger", "m"),
    "position": ("episode,step+1,xy", "m"),
    "judged_position": ("episode,step+1,xyz", "m"),
    "unstable": ("episode", ""),
    "gave_up": ("episode", ""),
    "violations": ("episode,limit", "step"),
    "violated": ("episode,step,limit", ""),
}


@dataclass(frozen=True, kw_only=True)
class Trajectories:
    """Recorded episodes; a quantity that the task does not have is None.

    Positions are in the frame of the robot's base. The achieved goal of an episode is the box in the plane of the table if
    there is one, else the gripper, else the point itself; a task with another one records it as `judged_position`.
    """

    time: Array  # (T+1,) s
    latent: Array  # (E, T, d)
    skill: Array  # (E, T) index of the skill whose mean the latent is, -1 for any other latent
    action: Array  # (E, T, a) how far each step moved the commanded targets, after all clipping: rad, m for the point
    reward: Array  # (E, T) the reward of the task
    target: Array  # (E, 3) m, the desired goal
    success: Array  # (E,) bool
    length: Array  # (E,) control steps
    joint_position: Array | None = None  # (E, T+1, 7) rad
    gripper_position: Array | None = None  # (E, T+1, 3) m, the gripper site
    object_pose: Array | None = None  # (E, T+1, 7) m, quaternion w x y z
    other_poses: Array | None = None  # (E, T+1, 7K) m, of K further objects, as `object_pose` one after the other
    finger_position: Array | None = None  # (E, T+1, 2) m, how far each finger of a hand is open
    position: Array | None = None  # (E, T+1, 2) m, the point task
    judged_position: Array | None = None  # (E, T+1, 3) m, the achieved goal, only if it is not the point named above
    unstable: Array | None = None  # (E,) bool: the simulation diverged; the last recorded state is the one before
    gave_up: Array | None = None  # (E,) bool: replanned until time was up, and not near the goal as far as sensors showed
    violations: Array | None = None  # (E, L) control steps whose end violates each of the first L `SAFETY_LIMITS`
    violated: Array | None = None  # (E, T, L) bool: the same for every control step; None: no limits, or an older file

    @property
    def episodes(self) -> int:
        """Return the number of episodes, E."""
        return int(self.length.shape[0])

    @cached_property
    def achieved_goal(self) -> Array:
        """Return the path of the achieved goal, (E, T+1, 3) m; box and point are in the plane z = 0."""
        return self.usual_achieved_goal if self.judged_position is None else self.judged_position

    @property
    def object_poses(self) -> Array | None:
        """Return the poses of all objects, (E, T+1, 7K) m; None without one."""
        if self.object_pose is None or self.other_poses is None:
            return self.object_pose
        return np.concatenate([self.object_pose, self.other_poses], axis=-1)

    @property
    def usual_achieved_goal(self) -> Array:
        """Return the path of the default achieved goal, (E, T+1, 3) m."""
        if self.object_pose is None and self.gripper_position is not None:
            return self.gripper_position
        plane = self.position if self.object_pose is None else self.object_pose[..., :2]
        if plane is None:
            raise ValueError("trajectories hold no position: object_pose, gripper_position or position is needed")
        return np.concatenate([plane, np.zeros_like(plane[..., :1])], axis=-1)

    @property
    def stable(self) -> Array:
        """Return which episodes are stable, (E,) bool."""
        return np.ones(self.episodes, dtype=bool) if self.unstable is None else ~self.unstable

    @property
    def given_up(self) -> Array:
        """Return which episodes gave up, (E,) bool."""
        return np.zeros(self.episodes, dtype=bool) if self.gave_up is None else self.gave_up

    @property
    def violation_steps(self) -> dict[str, Array]:
        """Count the control steps that violate each limit, (E,) by name; empty if the task has no limits."""
        if self.violations is None:
            return {}
        return dict(zip(SAFETY_LIMITS[: self.violations.shape[1]], self.violations.T, strict=True))

    @property
    def first_violations(self) -> list[dict[str, int]]:
        """Return the first control step of each episode that violates a limit, from 0, by the limit's name."""
        if self.violated is None:
            return [{} for _ in range(self.episodes)]
        first = np.where(self.violated.any(axis=1), self.violated.argmax(axis=1), -1)  # (E, L)
        return [
            {limit: step for limit, step in zip(SAFETY_LIMITS, steps, strict=False) if step >= 0} for steps in first.tolist()
        ]

    @property
    def within_limits(self) -> Array:
        """Return which episodes violate no safety limit, (E,) bool."""
        if self.violations is None:
            return np.ones(self.episodes, dtype=bool)
        return np.asarray(~self.violations.any(axis=1))

    def arrays(self) -> dict[str, Array]:
        """Return the present fields by name, as the store keeps them."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}

    def stored(self) -> dict[str, Array]:
        """Return the present fields by their paths in an artifact, whose `group("trajectories")` is what `arrays` returns."""
        return {f"trajectories/{name}": array for name, array in self.arrays().items()}

    def to_xarray(self) -> xarray.Dataset:
        """Return everything as one dataset with named dimensions, units and a clock; needs the extra `xarray`.

        States have the dimension `time`, (T+1,) s; what happens between two of them has `step`, whose coordinate is the time at
        its beginning, (T,) s. `xyz`, `xy`, `pose` and `limit` are labelled. Row `length` of an episode is its last state.
        """
        import xarray

        renamed = {"step+1": "time", "latent": "latent_axis", "action": "action_axis"}  # no dimension has the name of a field
        variables = {
            name: xarray.Variable([renamed.get(one, one) for one in AXES[name][0].split(",")], value, {"units": AXES[name][1]})
            for name, value in self.arrays().items()
            if name != "time"
        }
        sizes = {dimension: size for variable in variables.values() for dimension, size in variable.sizes.items()}
        labels = {name: list(all_labels[: sizes[name]]) for name, all_labels in _LABELS.items() if name in sizes}
        clock = {"time": ("time", self.time, {"units": "s"}), "step": ("step", self.time[:-1], {"units": "s"})}
        return xarray.Dataset(variables, {**clock, **labels})

    def with_success(self, success: Array) -> Trajectories:
        """Replace the success of the episodes, (E,) bool."""
        return replace(self, success=success)

    @staticmethod
    def join(parts: Sequence[Trajectories]) -> Trajectories:
        """Join recordings with the same control period; shorter ones repeat their last state."""
        longest = max(parts, key=lambda part: len(part.time))
        filled = _alike(parts)
        padded = [part.padded(len(longest.time) - 1) for part in filled]
        first = padded[0].arrays()
        joined = {name: np.concatenate([getattr(part, name) for part in padded]) for name in first if name != "time"}
        return Trajectories(time=longest.time, **joined)

    def padded(self, steps: int) -> Trajectories:
        """Extend the episodes to a clock of this many control steps; added rows repeat the last state with zero actions."""
        missing = steps - (len(self.time) - 1)
        if missing == 0:
            return self
        along_time = {name: value for name, value in self.arrays().items() if name in _PER_STEP}
        longer = {
            name: np.concatenate(
                [value, np.repeat(value.dtype.type(0) * value[:, -1:] if name in _DONE else value[:, -1:], missing, axis=1)],
                axis=1,
            )
            for name, value in along_time.items()
        }
        time = np.concatenate([self.time, self.time[-1] + np.arange(1, missing + 1) * (self.time[-1] - self.time[-2])])
        return replace(self, time=time, **longer)

    def select(self, episodes: Array | list[int] | slice) -> Trajectories:
        """Select episodes."""
        chosen = {name: value if name == "time" else value[episodes] for name, value in self.arrays().items()}
        return Trajectories(**chosen)


_LABELS = {"xyz": "xyz", "xy": "xy", "pose": ("x", "y", "z", "qw", "qx", "qy", "qz"), "limit": SAFETY_LIMITS}
_DONE = ("action", "reward", "violated")  # per-step fields: zero once an episode is over
_PER_STEP = (
    *_DONE,
    "latent",
    "skill",
    "joint_position",
    "gripper_position",
    "object_pose",
    "other_poses",
    "finger_position",
    "position",
    "judged_position",
)


def _alike(parts: Sequence[Trajectories]) -> list[Trajectories]:
    """Add fields that only some of the recordings have, with their default values."""
    if any(part.judged_position is not None for part in parts):
        parts = [replace(part, judged_position=part.achieved_goal) for part in parts]
    if any(part.unstable is not None for part in parts):
        parts = [replace(part, unstable=~part.stable) for part in parts]
    if any(part.gave_up is not None for part in parts):
        parts = [replace(part, gave_up=part.given_up) for part in parts]
    if any(part.violated is not None for part in parts):
        parts = [part if part.violated is not None else replace(part, violated=_none_violated(part)) for part in parts]
    return list(parts)


def _none_violated(part: Trajectories) -> Array | None:
    """Return that no control step violates a limit, (E, T, L) bool; None if the task has no limits."""
    if part.violations is None:
        return None
    return np.zeros((*part.skill.shape, part.violations.shape[1]), dtype=bool)
