"""Examine an arm at given joint angles: whether its servos hold it, what overlaps, and how far its finger reaches."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import mujoco
import numpy as np

from skillcli.robots.config import Workspace
from skillcli.robots.scene import GRIPPER, LIMIT_MARGIN, Names
from skillcli.robots.servos import Servo
from skillcli.trajectories import Array

OVERLAP = 0.002001  # m: just above 2 mm, by which fingers are often modelled to overlap
SAMPLED = 40  # random postures
ALWAYS = 0.9  # share of them in which links must overlap to count as built into each other
HELD_SECONDS = 3.0  # s after which an arm has come to rest
SAGS = 0.5, 0.005  # degrees and m from the commanded pose that are worth a note
FARTHEST = 100.0  # rad: whole turns of a joint, beyond which the simulation is unstable


def gripper_and_axes(model: mujoco.MjModel, names: Names, angles: tuple[float, ...]) -> tuple[Array, Array]:
    """Compute the gripper's position, (3,) m, and the joint axes, (n, 3), at joint angles (n,) rad."""
    data = posed(model, names, angles)
    axes = np.stack([data.xaxis[model.joint(name).id] for name in names.joints])
    return data.site(GRIPPER).xpos.copy(), axes


def posed(model: mujoco.MjModel, names: Names, angles: tuple[float, ...]) -> mujoco.MjData:
    """Put the arm at joint angles (n,) rad, at rest."""
    data = mujoco.MjData(model)
    for name, angle in zip(names.joints, angles, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_fwdPosition(model, data)
    return data


def held(model: mujoco.MjModel, names: Names, angles: tuple[float, ...]) -> mujoco.MjData:
    """Put the arm at rest at joint angles (n,) rad, told to stay there."""
    data = posed(model, names, angles)
    for name, angle in zip(names.servos, angles, strict=True):
        data.ctrl[model.actuator_ctrladr[model.actuator(name).id]] = angle
    return data


def joint_ranges(model: mujoco.MjModel, joints: Iterable[str], free: float = np.inf) -> Array:
    """Return the lowest and highest angle of joints, (n, 2) rad; plus and minus `free` without limits."""
    found = [model.joint(name) for name in joints]
    return np.array([joint.range if model.jnt_limited[joint.id] else (-free, free) for joint in found])


def joint_inertia(model: mujoco.MjModel, data: mujoco.MjData, joints: Iterable[str]) -> Array:
    """Return the inertia matrix of joints where `data` was moved to, (n, n) kg·m²."""
    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    dofs = [model.joint(name).dofadr[0] for name in joints]
    inertia: Array = whole[np.ix_(dofs, dofs)]
    return inertia


def workspace(model: mujoco.MjModel, names: Names) -> Workspace:
    """Bound where the finger can be: within the sum of the distances between joints, around the height of the second one."""
    data = posed(model, names, (0.0,) * len(names.joints))
    anchors = [data.xanchor[model.joint(name).id] for name in names.joints]
    first, axis = anchors[0], data.xaxis[model.joint(names.joints[0]).id]
    shoulder = first + ((anchors[1] - first) @ axis) * axis
    places = [shoulder, *anchors[1:], data.site(GRIPPER).xpos]
    reach = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
    x, y, z = (float(part) for part in shoulder)
    return Workspace(shoulder=(x, y, z), reach=reach)


def shakes(model: mujoco.MjModel, names: Names, servos: list[Servo], angles: tuple[float, ...]) -> bool:
    """Check whether explicit damping overshoots in a time step h: the largest eigenvalue of M^-1 K_v is above 1/h."""
    if model.opt.integrator not in (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4):
        return False
    inertia = joint_inertia(model, posed(model, names, angles), names.joints)
    rates = np.linalg.eigvals(np.linalg.solve(inertia, np.diag([servo.kv for servo in servos])))
    return bool(model.opt.timestep * np.abs(rates).max() > 1)


def steady(
    scene: mujoco.MjSpec,
    model: mujoco.MjModel,
    names: Names,
    servos: list[Servo],
    shown: tuple[str, ...],
    angles: tuple[float, ...],
) -> list[str]:
    """Give joints that are too light for their servos the inertia of a motor, and note it.

    At its largest torque a servo is switched rather than damped, whatever the integrator: a step h then changes the speed
    by F h / I, and damping answers with F at most. With an inertia I of k_v h the joint comes to rest, below it shakes. The
    inertia that a servo feels is computed at joint angles (n,) rad, with the other joints free.
    """
    felt = 1 / np.diag(np.linalg.inv(joint_inertia(model, posed(model, names, angles), names.joints)))
    missing = np.zeros(len(servos))
    for index, (servo, inertia) in enumerate(zip(servos, felt, strict=True)):
        if np.isfinite(servo.force).any():
            missing[index] = max(0.0, servo.kv * model.opt.timestep - inertia)
            scene.joint(names.joints[index]).armature += missing[index]
    light = ", ".join(name for name, more in zip(shown, missing, strict=True) if more > 0)
    if not light:
        return []
    return [
        f"up to {missing.max():.2g} kg·m² of motor inertia were added to {light}: at their largest torque these servos would "
        "shake at this time step"
    ]


def overlaps(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[int, int]]:
    """Find pairs of geoms that overlap at the joint angles of `data`."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return {(int(contact.geom1), int(contact.geom2)) for contact in data.contact if contact.dist < -OVERLAP}


def part_neighbours(scene: mujoco.MjSpec, model: mujoco.MjModel, names: Names, prefix: str) -> list[str]:
    """Exclude contact between links that overlap in nearly every posture, and note them: it would lock their joints."""
    rng, data = np.random.default_rng(0), mujoco.MjData(model)
    joints = [model.joint(name) for name in names.joints]
    ranges = joint_ranges(model, names.joints, free=np.pi)
    counts: dict[tuple[str, str], int] = {}
    for _ in range(SAMPLED):
        for joint, angle in zip(joints, rng.uniform(ranges[:, 0], ranges[:, 1]), strict=True):
            data.qpos[joint.qposadr[0]] = angle
        pairs = {tuple(sorted(model.body(model.geom_bodyid[geom]).name for geom in pair)) for pair in overlaps(model, data)}
        for a, b in pairs:
            counts[a, b] = counts.get((a, b), 0) + 1
    always = sorted(pair for pair, count in counts.items() if count >= ALWAYS * SAMPLED)
    for a, b in always:
        scene.add_exclude(bodyname1=a, bodyname2=b)
    if not always:
        return []
    shown = ", ".join(" and ".join(name.removeprefix(prefix) for name in pair) for pair in always)
    return [f"these overlap wherever the arm stands, so they do not touch each other: {shown}"]


def collisions(model: mujoco.MjModel, names: Names, angles: tuple[float, ...], prefix: str) -> list[str]:
    """Note parts that overlap at joint angles (n,) rad: joints may be stuck there."""
    data = posed(model, names, angles)
    deep = [contact.geom for contact in data.contact if contact.dist < -OVERLAP]
    pairs = {tuple(model.body(model.geom_bodyid[geom]).name.removeprefix(prefix) for geom in pair) for pair in deep}
    shown = ", ".join(sorted(" and ".join(pair) for pair in pairs))
    return [f"at the task's start these overlap, an <exclude> may be missing: {shown}"] if pairs else []


def at_rest(model: mujoco.MjModel, names: Names, shown: tuple[str, ...], angles: tuple[float, ...]) -> list[str]:
    """Note if the arm, commanded to stay at joint angles (n,) rad, sags or is made unstable by its servos."""
    joints = [model.joint(name) for name in names.joints]
    addresses = [joint.qposadr[0] for joint in joints]
    low, high = joint_ranges(model, names.joints).T
    told = np.clip(angles, low + LIMIT_MARGIN, high - LIMIT_MARGIN)
    data = held(model, names, tuple(told))
    here = data.site(GRIPPER).xpos.copy()
    for _ in range(round(HELD_SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if not (np.abs(data.qpos) < FARTHEST).all():
            return ["told to stay at its start the arm comes apart: its gains are too high for the time step"]
    off = np.degrees(np.abs(data.qpos[addresses] - told))
    away = float(np.linalg.norm(data.site(GRIPPER).xpos - here))
    if off.max() < SAGS[0] and away < SAGS[1]:
        return []
    carried = bool(np.all(model.body_gravcomp[model.jnt_bodyid[[joint.id for joint in joints]]] >= 1))
    why = "" if carried else ": the controller does not carry its weight, with `gravity_compensation = true` it does"
    worst = shown[int(off.argmax())]
    return [f"at rest the arm hangs {100 * away:.1f} cm off where it is told to be, {worst!r} by {off.max():.1f}°{why}"]
