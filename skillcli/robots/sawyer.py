"""The Sawyer arm as data: where its model lies, its names and its limits, and the table in front of it."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

MODEL_FILE = Path(__file__).parent / "models" / "sawyer.xml"
JOINTS = tuple(f"right_j{i}" for i in range(7))
GRIPPER = "gripper"  # the site at the finger's tip: tasks are judged there


class Names(NamedTuple):
    """What an arm calls its parts."""

    joints: tuple[str, ...]  # seven, from the base to the hand
    servos: tuple[str, ...]  # the position actuator of each
    finger: tuple[str, ...]  # geoms that push


NAMES = Names(JOINTS, JOINTS, ("palm", "rod"))

# Rethink's public sawyer_description, rad/s; 0.04 rad in 50 ms is 0.8 rad/s and keeps every joint below them.
VELOCITY_LIMIT = np.array([1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545])

# No point of the finger is farther from here, m: the axis of the first joint at the height of the second, and the sum
# of the distances between successive joint origins from there to the finger's tip.
SHOULDER = np.array([0.0, 0.0, 0.317])
LONGEST_REACH = 1.34

# The column that base, first link and head fill, m: no finger gets in there.
BASE_RADIUS, BASE_HEIGHT = 0.12, 0.5

# The commanded target stops this far inside the joint range, rad: a servo with these gains overshoots less.
LIMIT_MARGIN = 0.02

# Control samples are kept this long per actuator where a domain may delay it, s.
DELAY_HISTORY = 0.16

TABLE_TOP = 0.0  # m: the robot's base stands on the same height
TABLE_CENTRE = (0.72, 0.0)
TABLE_HALF_SIZE = (0.42, 0.6, 0.02)


def arm_spec(timestep: float, delay: bool = False) -> mujoco.MjSpec:
    """The arm with its finger behind a table, ready for a task to add what it needs.

    Args:
        timestep: of the physics, s.
        delay: whether actuators keep a history, so that a domain can delay them.
    """
    spec = mujoco.MjSpec.from_file(str(MODEL_FILE))
    add_table(spec)
    set_clock(spec, timestep, delay)
    return spec


def set_clock(spec: mujoco.MjSpec, timestep: float, delay: bool) -> None:
    """Set the time step, s, and let the servos remember their commands for the latency they have or a domain may give them."""
    spec.option.timestep = timestep
    for name in NAMES.servos:
        servo = spec.actuator(name)
        history = servo.delay + (DELAY_HISTORY if delay else 0.0)
        servo.nsample = 1 + math.ceil(history / timestep) if history else 0


def add_table(spec: mujoco.MjSpec) -> None:
    """Put the table where all tasks have it."""
    table = spec.worldbody.add_body(name="table", pos=[*TABLE_CENTRE, TABLE_TOP - TABLE_HALF_SIZE[2]])
    table.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=TABLE_HALF_SIZE,
        rgba=[0.78, 0.72, 0.62, 1],
        priority=1,  # else the larger friction of a pair counts, and a slippery table never would
        friction=[0.6, 0.005, 1e-4],
    )


def fingerprint(spec: mujoco.MjSpec) -> str:
    """SHA-256 of the model as MJCF text."""
    return hashlib.sha256(spec.to_xml().encode()).hexdigest()
