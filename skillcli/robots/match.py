"""Check whether an arm is built like another one: only then do skills, which are joint motions, carry over."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.posture import gripper_and_axes
from skillcli.robots.scene import Names
from skillcli.trajectories import Array

# Another build of the Sawyer differs by centimetres; the nearest other arm of seven joints by 18 cm, the width of the shoulder.
FARTHEST, WIDEST = 0.1, 30.0  # m, degrees
_PARALLEL = 1e-3  # sine of the angle below which two axes have no one point nearest to each other
# Skills see joint angles and move them: at one pose the gripper must be about where the source has it, each joint turning
# about much the same axis. Another arm of the same build is within centimetres; wrong conventions are not.
FARTHEST_GRIPPER, NOTICED = 0.25, 0.05  # m
LEAST_COSINE = math.cos(math.radians(45))
OTHER_ARM = "skills are joint motions of one arm and do not carry over to another: train on that one"


@dataclass(frozen=True)
class Source:
    """The arm that skills were trained on, at its home."""

    name: str
    model: mujoco.MjModel
    names: Names
    home: tuple[float, ...]


def check_build(model: mujoco.MjModel, joints: tuple[str, ...], source: Source) -> None:
    """Refuse an arm of another build, whatever the names of its joints.

    The measures do not depend on zeros and signs of the joints, nor on the pose of the base.

    Raises:
        UsageError: the arm is another one.
    """
    expected_count = len(source.names.joints)
    if len(joints) != expected_count:
        raise UsageError(
            f"joints: must name {_counted(expected_count)}, as the arm of the skills has, got {len(joints)}",
            f"an arm with another number of joints is another arm: {OTHER_ARM}",
        )
    here, there = _measures(model, joints), _measures(source.model, source.names.joints)
    other = f"this looks like another arm than the {source.name!r} of the skills"
    hint = f"{OTHER_ARM}; if it is the same, check that `joints` names its {_counted(expected_count)}"
    for pair, (angle, expected) in enumerate(zip(here[0], there[0], strict=True)):
        if abs(angle - expected) > WIDEST:
            a, b = joints[pair : pair + 2]
            said = f"the axes of {a!r} and {b!r} cross at {angle:.0f}°, where those of the source do so at {expected:.0f}°"
            raise UsageError(f"{other}: {said}", hint)
    for pair, (gap, expected) in enumerate(zip(here[1], there[1], strict=True)):
        if abs(gap - expected) > FARTHEST:
            a, b = joints[pair : pair + 2]
            said = f"the axes of {a!r} and {b!r} pass each other {100 * gap:.0f} cm apart"
            raise UsageError(f"{other}: {said}, where those of the source do so {100 * expected:.0f} cm", hint)
    for joint, (length, expected) in enumerate(zip(here[2], there[2], strict=True)):
        if abs(length - expected) > FARTHEST:
            said = f"{joints[joint + 1]!r} has {100 * length:.0f} cm along its axis between its neighbours'"
            raise UsageError(f"{other}: {said}, where the source has {100 * expected:.0f} cm", hint)


def _counted(number: int) -> str:
    return {4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight"}.get(number, str(number))


def check_conventions(model: mujoco.MjModel, names: Names, joints: tuple[str, ...], source: Source) -> tuple[Array, list[str]]:
    """Compare gripper and joint axes with those of the source, both arms at the source's home.

    Returns:
        The gripper's position relative to the source's, (3,) m, and a note if it is far off.

    Raises:
        UsageError: order, sign or zero of a joint differs, or the base does.
    """
    here, axes = gripper_and_axes(model, names, source.home)
    there, expected = gripper_and_axes(source.model, source.names, source.home)
    cosine = np.einsum("ij,ij->i", axes, expected)
    wrong = np.flatnonzero(cosine < LEAST_COSINE)
    if len(wrong):
        worst = wrong[0]
        raise UsageError(
            f"joints: {joints[worst]!r} turns about {_shown(axes[worst])} at the task's start, where joint {worst + 1} of the "
            f"source turns about {_shown(expected[worst])} ({len(wrong)} of {len(joints)} joints differ by more than 45°)",
            "check the order of `joints`, their signs and zero positions, and base.quat",
        )
    away: Array = here - there
    distance = float(np.linalg.norm(away))
    if distance > FARTHEST_GRIPPER:
        raise UsageError(
            f"gripper: at the task's start it is at {_shown(here)} m, {distance:.2f} m from {_shown(there)} where "
            f"the source has it; at most {FARTHEST_GRIPPER:g} m is taken for another build of the same arm",
            "check `gripper`, base.pos, and the zero positions of `joints`",
        )
    far = distance > NOTICED
    return away, [f"at the task's start the gripper is {100 * distance:.0f} cm from where the source has it"] if far else []


def _shown(vector: Array) -> str:
    return "(" + ", ".join(f"{x:.2f}" for x in vector + 0.0) + ")"


def _measures(model: mujoco.MjModel, joints: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """Measure n joint axes: the parameters of Denavit and Hartenberg (1955) without joint angles and signs.

    Returns:
        Angles between neighbouring axes, (n-1,) degrees; distances between them, (n-1,) m; and lengths (n-2,) m along each
        inner axis, from the point nearest to the axis before it to the point nearest to the one behind it.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = [model.joint(name).id for name in joints]
    lines = list(zip(data.xanchor[ids], data.xaxis[ids], strict=True))
    pairs = [_nearest(*a, *b) for a, b in pairwise(lines)]
    angle = [np.degrees(np.arccos(min(1.0, abs(float(a[1] @ b[1]))))) for a, b in pairwise(lines)]
    gap = [float(np.linalg.norm(on_a - on_b)) for on_a, on_b in pairs]
    length = [float(np.linalg.norm(before[1] - behind[0])) for before, behind in pairwise(pairs)]
    return np.array(angle), np.array(gap), np.array(length)


def _nearest(a: Array, along_a: Array, b: Array, along_b: Array) -> tuple[Array, Array]:
    """Find the nearest points of two lines, (3,) m on each; of parallel lines a point of b and its foot on a."""
    across, way = np.cross(along_a, along_b), b - a
    size = float(across @ across)
    if size < _PARALLEL**2:
        return a + (way @ along_a) * along_a, b
    return a + (np.cross(way, along_b) @ across / size) * along_a, b + (np.cross(way, along_a) @ across / size) * along_b
