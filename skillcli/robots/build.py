"""How an arm is built: what of its joint axes stays the same whatever their zeros, their signs and where it stands."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots import sawyer
from skillcli.robots.config import OTHER_ARM
from skillcli.trajectories import Array

# Another build of the Sawyer differs by centimetres; the nearest other arm of seven joints by 18 cm, the width of the shoulder.
FARTHEST, WIDEST = 0.1, 30.0  # m, degrees
_PARALLEL = 1e-3  # sine of the angle below which two axes have no one point nearest to each other


def check_build(model: mujoco.MjModel, joints: tuple[str, ...]) -> None:
    """Refuse an arm that is plainly not a Sawyer, however its joints are named, ordered and counted.

    Raises:
        UsageError: it is another arm.
    """
    here, there = (_measures(*each) for each in ((model, joints), (sawyer.arm_spec(0.005).compile(), sawyer.JOINTS)))
    for pair, (angle, expected) in enumerate(zip(here[0], there[0], strict=True)):
        if abs(angle - expected) > WIDEST:
            raise _another(joints, pair, f"cross at {angle:.0f}°", f"at {expected:.0f}°")
    for pair, (gap, expected) in enumerate(zip(here[1], there[1], strict=True)):
        if abs(gap - expected) > FARTHEST:
            raise _another(joints, pair, f"pass each other {100 * gap:.0f} cm apart", f"{100 * expected:.0f} cm")
    for joint, (length, expected) in enumerate(zip(here[2], there[2], strict=True)):
        if abs(length - expected) > FARTHEST:
            said = f"{joints[joint + 1]!r} has {100 * length:.0f} cm along its axis between its neighbours'"
            raise UsageError(f"{_OTHER}: {said}, where the source has {100 * expected:.0f} cm", _HINT)


_OTHER = "this looks like another arm than the Sawyer"
_HINT = f"{OTHER_ARM}; if it is a Sawyer, check that `joints` names its seven"


def _another(joints: tuple[str, ...], pair: int, said: str, expected: str) -> UsageError:
    a, b = joints[pair : pair + 2]
    return UsageError(f"{_OTHER}: the axes of {a!r} and {b!r} {said}, where those of the source do so {expected}", _HINT)


def _measures(model: mujoco.MjModel, joints: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """What seven axes keep: the parameters of Denavit and Hartenberg (1955) but for the joint angles, without signs.

    Returns:
        Angles between neighbours (6,) degrees; how far these pass each other (6,) m; and the ways (5,) m along an axis from
        where the one before comes nearest to where the one behind does.
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
    """The points of two lines nearest to each other, (3,) m on each; of parallel ones a point of b and its foot on a."""
    across, way = np.cross(along_a, along_b), b - a
    size = float(across @ across)
    if size < _PARALLEL**2:
        return a + (way @ along_a) * along_a, b
    return a + (np.cross(way, along_b) @ across / size) * along_a, b + (np.cross(way, along_a) @ across / size) * along_b
