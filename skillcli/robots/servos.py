"""Bring whatever drives a foreign arm to one form: position servos in rad and N·m at the joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.config import Gains
from skillcli.trajectories import Array

# Integers, as in compiled models.
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_STATELESS = int(mujoco.mjtDyn.mjDYN_NONE)
_AT_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
_AFFINE_BIAS, _NO_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE), int(mujoco.mjtBias.mjBIAS_NONE)
FREE = (-np.inf, np.inf)
LATEST = 1.0  # s


@dataclass(frozen=True)
class Servo:
    """A position servo: torque = kp (target - angle) - kv speed, within limits."""

    joint: str
    kp: float  # N·m/rad
    kv: float  # N·m·s/rad
    force: tuple[float, float] = FREE  # N·m
    target: tuple[float, float] = FREE  # rad
    delay: float = 0.0  # s
    damping: float = 0.0  # N·m·s/rad, of the transmission
    armature: float = 0.0  # kg·m², of the transmission
    filter: tuple[Any, float] | None = None  # kind of filter on the command, and its time constant, s


def find_servos(
    model: mujoco.MjModel, joints: Sequence[str], named: Sequence[str] | None, gains: Gains | None
) -> tuple[list[Servo], list[int]]:
    """Find the servo of each joint, and the model's actuators that it replaces.

    With gains, every actuator of a joint is replaced. Without, each joint must have exactly one position servo; its other
    actuators stay, at their default control.

    Raises:
        UsageError: a joint has no servo and no gains, or several servos, or an actuator's name does not fit.
    """
    servos, replaced = [], []
    for index, joint in enumerate(joints):
        acting = _acting_on(model, joint)
        chosen = acting if named is None else [_named(model, named[index], joint, acting)]
        own = [i for i in chosen if _is_position(model, i)]
        if gains is not None:
            force = _force_of(model, chosen) if gains.force is None else (-gains.force[index], gains.force[index])
            delay = max((_delay_of(model, joint, i) for i in chosen), default=0.0)
            servos.append(Servo(joint, gains.kp[index], gains.kv[index], force, delay=delay, **_reflected(model, chosen)))
            replaced += acting
            continue
        if len(own) != 1:
            raise _no_single_servo(model, joint, acting, own)
        servos.append(_normalised(model, joint, own[0]))
        others = [i for i in acting if i != own[0] and _is_position(model, i)]  # would pull to zero
        replaced += [own[0], *others]
    return servos, replaced


def add_servo(spec: mujoco.MjSpec, name: str, joint: str, servo: Servo) -> None:
    """Add the servo of a joint; its control is the target in rad."""
    actuator = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=servo.kp, kv=servo.kv)
    if servo.filter is not None:
        actuator.dyntype, actuator.dynprm[0] = servo.filter
    actuator.forcelimited, actuator.forcerange = _range(servo.force)
    actuator.ctrllimited, actuator.ctrlrange = _range(servo.target)
    actuator.delay = servo.delay


def lay_on_joint(joint: Any, servo: Servo) -> None:
    """Add armature and damping of the transmission to the joint, where domains scale them."""
    joint.armature += servo.armature
    joint.damping[0] += servo.damping


def _range(limits: tuple[float, float]) -> tuple[bool, list[float]]:
    finite = bool(np.isfinite(limits).all())
    return finite, list(limits) if finite else [0.0, 0.0]


def _acting_on(model: mujoco.MjModel, joint: str) -> list[int]:
    at = model.joint(joint).id
    return [i for i in range(model.nactuator) if model.actuator_trntype[i] in _AT_JOINT and model.actuator_trnid[i, 0] == at]


def _named(model: mujoco.MjModel, name: str, joint: str, acting: list[int]) -> int:
    names = {model.actuator(i).name: i for i in range(model.nactuator)}
    if name not in names:
        raise UsageError(
            f"actuators: no actuator {name!r} in the model", f"actuators: {', '.join(filter(None, names)) or 'none'}"
        )
    if names[name] not in acting:
        there = ", ".join(repr(model.actuator(i).name) for i in acting) or "none"
        raise UsageError(
            f"actuators: {name!r} does not drive joint {joint!r}",
            f"name them in the order of the joints; on {joint!r}: {there}",
        )
    return names[name]


def _is_position(model: mujoco.MjModel, i: int) -> bool:
    """Check whether actuator i is a position servo: its force is affine, and pulls towards an angle that the control sets."""
    return bool(
        model.actuator_gaintype[i] == _FIXED_GAIN
        and model.actuator_biastype[i] == _AFFINE_BIAS
        and model.actuator_dyntype[i] in (_STATELESS, *_FILTERS)
        and model.actuator_ctrlnum[i] == 1
        and model.actuator_plugin[i] < 0
        and model.actuator_gainprm[i, 0] != 0
        and model.actuator_biasprm[i, 1] < 0
        and _gear(model, i) != 0
    )


def _no_single_servo(model: mujoco.MjModel, joint: str, acting: list[int], own: list[int]) -> UsageError:
    if own:
        names = ", ".join(repr(model.actuator(i).name) for i in own)
        return UsageError(f"joint {joint!r} has {len(own)} position servos: {names}", "say which, with `actuators`")
    what = "no position servo, only a motor or another actuator" if acting else "no actuator"
    return UsageError(
        f"gains: joint {joint!r} has {what}",
        "give [gains] with kp and kv, one number for each joint; for a Sawyer about 500 and 50",
    )


def _gear(model: mujoco.MjModel, i: int) -> float:
    return float(model.actuator_gear[model.actuator_outadr[i], 0])


def _normalised(model: mujoco.MjModel, joint: str, i: int) -> Servo:
    """Rewrite force = g (k u + b0 + b1 g q + b2 g v) as kp (target - q) - kv v."""
    gear, gain = _gear(model, i), float(model.actuator_gainprm[i, 0])
    offset, slope, rate = (float(x) for x in model.actuator_biasprm[i, :3])
    address = model.actuator_ctrladr[i]
    target = FREE
    if model.actuator_ctrllimited[address]:
        low, high = sorted(-(gain * u + offset) / (slope * gear) for u in model.actuator_ctrlrange[address])
        target = (float(low), float(high))
    kind = int(model.actuator_dyntype[i])
    return Servo(
        joint=joint,
        kp=-slope * gear**2,
        kv=-rate * gear**2,
        force=_force_of(model, [i]),
        target=target,
        delay=_delay_of(model, joint, i),
        filter=(mujoco.mjtDyn(kind), float(model.actuator_dynprm[i, 0])) if kind in _FILTERS else None,
        **_reflected(model, [i]),
    )


def _delay_of(model: mujoco.MjModel, joint: str, i: int) -> float:
    delay = float(model.actuator_delay[i])
    if not 0 <= delay <= LATEST:
        raise UsageError(
            f"model: the actuator of {joint!r} is {delay:g} s late, at most {LATEST:g} s are taken", "fix the MJCF file"
        )
    return delay


def _reflected(model: mujoco.MjModel, chosen: list[int]) -> dict[str, Any]:
    """Sum what transmissions add to their joint: damping and armature."""
    return {
        "damping": sum(float(model.actuator_damping[i]) * _gear(model, i) ** 2 for i in chosen),
        "armature": sum(float(model.actuator_armature[i]) * _gear(model, i) ** 2 for i in chosen),
    }


def torque_of(model: mujoco.MjModel, joints: Sequence[str]) -> Array:
    """Return the largest torque of each joint's drive, (n,) N·m; infinite if the model gives none."""
    found = []
    for joint in joints:
        at = model.joint(joint).id
        low, high = _force_of(model, _acting_on(model, joint))
        if model.jnt_actfrclimited[at]:
            low, high = max(low, model.jnt_actfrcrange[at, 0]), min(high, model.jnt_actfrcrange[at, 1])
        found.append(min(-low, high))
    return np.array(found, dtype=float)


def _force_of(model: mujoco.MjModel, chosen: list[int]) -> tuple[float, float]:
    """Return the torque limits of a joint's actuators, N·m: the widest of them."""
    limits = []
    for i in chosen:
        low, high = FREE
        address = model.actuator_ctrladr[i]
        motor = model.actuator_biastype[i] == _NO_BIAS
        if motor and model.actuator_ctrllimited[address] and model.actuator_gaintype[i] == _FIXED_GAIN:
            low, high = sorted(model.actuator_gainprm[i, 0] * model.actuator_ctrlrange[address])
        if model.actuator_forcelimited[i]:
            low, high = max(low, model.actuator_forcerange[i, 0]), min(high, model.actuator_forcerange[i, 1])
        low, high = sorted(_gear(model, i) * bound for bound in (low, high))
        limits.append((float(low), float(high)))
    return max(limits, key=lambda pair: pair[1] - pair[0], default=FREE)
