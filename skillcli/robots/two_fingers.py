"""Find the two fingers of a hand that a robot file describes."""

from __future__ import annotations

import mujoco

from skillcli.errors import UsageError
from skillcli.robots.config import Description
from skillcli.robots.scene import Hand

_AT_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
LEEWAY = 1e-6  # m


def find_hand(model: mujoco.MjModel, description: Description, prefix: str) -> Hand | None:
    """Return the hand of a description in the compiled scene; None if it has none.

    Args:
        model: of arm and table.
        description: what the robot file says.
        prefix: of all names of the arm in the scene.

    Raises:
        UsageError: joints or servos do not fit.
    """
    said = description.hand
    if said is None:
        return None
    known = {model.joint(joint).name: joint for joint in range(model.njnt)}
    servos = []
    for index, shown in enumerate(said.joints):
        joint = known.get(prefix + shown)
        if joint is None:
            names = ", ".join(name.removeprefix(prefix) for name in known if name)
            raise UsageError(f"hand.joints: no joint {shown!r} in the model", f"joints there: {names}")
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE:
            raise UsageError(f"hand.joints: {shown!r} does not slide", "only fingers that slide towards each other are known")
        if model.jnt_limited[joint] and said.widest > 2 * model.jnt_range[joint, 1] + LEEWAY:
            raise UsageError(
                f"hand.widest: {said.widest:g} m, but {shown!r} slides by {model.jnt_range[joint, 1]:g} m",
                "two fingers that slide alike open by twice that",
            )
        servos.append(_servo(model, joint, shown, prefix, said.actuators[index] if said.actuators else None))
    first, second = (prefix + shown for shown in said.joints)
    return Hand((first, second), (servos[0], servos[1]), said.widest, said.force, said.speed)


def _servo(model: mujoco.MjModel, joint: int, shown: str, prefix: str, wanted: str | None) -> str:
    acting = [
        i for i in range(model.nactuator) if model.actuator_trntype[i] in _AT_JOINT and model.actuator_trnid[i, 0] == joint
    ]
    names = [str(model.actuator(i).name) for i in acting]
    chosen = [name for name in names if wanted is None or name == prefix + wanted]
    if len(chosen) != 1 or not chosen[0]:
        there = ", ".join(repr(name.removeprefix(prefix)) for name in names) or "none"
        raise UsageError(
            f"hand.actuators: {shown!r} needs one position servo with a name, there: {there}", "name it with `actuators`"
        )
    return chosen[0]
