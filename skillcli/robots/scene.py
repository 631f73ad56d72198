"""Build the scene around every arm: a table, the clock, and the names of the arm's parts."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable
from typing import NamedTuple

import mujoco

GRIPPER = "gripper"  # the site at the tip of the finger: the achieved goal of reach

# The commanded target stops this far inside the joint range, rad: a servo with gains such as the Sawyer's overshoots less.
LIMIT_MARGIN = 0.02

# Control samples are kept this long per actuator where a domain may delay it, s.
DELAY_HISTORY = 0.16

TABLE_TOP = 0.0  # m: the robot's base stands on the same height
TABLE_CENTRE = (0.72, 0.0)
TABLE_HALF_SIZE = (0.42, 0.6, 0.02)


class Names(NamedTuple):
    """Names of an arm's parts in the scene."""

    joints: tuple[str, ...]  # n, from the base to the hand
    servos: tuple[str, ...]  # the position actuator of each
    finger: tuple[str, ...]  # geoms that push


class Hand(NamedTuple):
    """The two fingers of a hand in the scene, and their data sheet."""

    joints: tuple[str, str]  # slide joints, zero where the fingers meet
    servos: tuple[str, str]  # the position actuator of each
    widest: float  # m, between the open fingers
    force: float  # N, largest lasting force of each finger
    speed: float  # m/s, largest change of the width


def set_clock(spec: mujoco.MjSpec, servos: Iterable[str], timestep: float, delay: bool) -> None:
    """Set the time step, s, and let servos store past commands, for their own delay and, with `delay`, that of a domain."""
    spec.option.timestep = timestep
    for name in servos:
        servo = spec.actuator(name)
        history = servo.delay + (DELAY_HISTORY if delay else 0.0)
        servo.nsample = 1 + math.ceil(history / timestep) if history else 0


def add_table(spec: mujoco.MjSpec) -> None:
    """Add the table, at the same place for all tasks."""
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
    """Hash the model as MJCF text without comments, with SHA-256."""
    return hashlib.sha256(re.sub("<!--.*?-->", "", spec.to_xml(), flags=re.DOTALL).encode()).hexdigest()
