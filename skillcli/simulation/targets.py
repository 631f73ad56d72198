"""The commanded targets of an arm: where they may be, and how one control step moves them."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots.posture import joint_ranges
from skillcli.robots.scene import LIMIT_MARGIN, Names
from skillcli.trajectories import Array


def command_range(model: mujoco.MjModel, names: Names) -> Array:
    """Return the lowest and highest target of each joint, (J, 2) rad: within its range by a margin, and within its servo's.

    Args:
        model: has the servos of `names` one behind the other.
        names: the model's names of joints and servos.
    """
    ranges = joint_ranges(model, names.joints)
    first = model.actuator_ctrladr[model.actuator(names.servos[0]).id]
    own = slice(first, first + len(names.servos))
    told = np.where(model.actuator_ctrllimited[own, None], model.actuator_ctrlrange[own], (-np.inf, np.inf))
    return np.stack(
        [np.maximum(ranges[:, 0] + LIMIT_MARGIN, told[:, 0]), np.minimum(ranges[:, 1] - LIMIT_MARGIN, told[:, 1])], axis=1
    )


def next_target(commanded: Array, increment: Array, measured: Array, low: Array, high: Array, lead: float) -> Array:
    """Add increments to commanded targets, (N, J) rad each.

    Args:
        commanded: (N, J) rad, the targets so far.
        increment: (N, J) rad, within the action limit.
        measured: (N, J) rad, the joint angles.
        low: (J,) rad, the lowest targets.
        high: (J,) rad, the highest targets.
        lead: how far a target may be from the measured angle, rad.
    """
    target: Array = np.clip(np.clip(commanded + increment, measured - lead, measured + lead), low, high)
    return target
