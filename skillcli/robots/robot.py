"""Another robot for the tasks: read from a robot file, checked against the arm that the skills were trained on."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots import import_mjcf as foreign
from skillcli.robots import sawyer
from skillcli.robots.config import LONGEST_TIMESTEP, SHORTEST_TIMESTEP, Description, blaming, read_description
from skillcli.robots.mjcf import compile_model, quietly
from skillcli.robots.servos import Servo
from skillcli.simulation.arms import Arms
from skillcli.simulation.environment import Array
from skillcli.simulation.settings import ArmTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask

# Skills see joint angles and move them: at one pose the gripper must be about where the source has it, each joint turning
# about much the same axis. Another arm of the same build is within centimetres; wrong conventions are not.
FARTHEST, NOTICED = 0.25, 0.05  # m
OVERLAP = 0.002  # m
HELD, HELD_STEPS = 0.05, 60  # s, and how many of them: the arm has come to rest after 3 s
SAGS = 0.5, 0.005  # degrees and m from where it is told to be that are worth a note
LEAST_COSINE = math.cos(math.radians(45))


@dataclass(frozen=True)
class Robot:
    """A robot that is not the source.

    Attributes:
        path: of the robot file.
        description: what it says.
        names: what the arm calls its parts.
        notes: what was left out of the model, and other things worth knowing.
        fingerprint: SHA-256 over what the robot file says and the model that came of it, whatever the folder.
        summary: JSON-able, for the record.
    """

    path: Path
    description: Description
    names: sawyer.Names
    notes: tuple[str, ...]
    fingerprint: str
    summary: dict[str, Any]
    scene: mujoco.MjSpec  # behind our table; a task works on a copy
    model: mujoco.MjModel  # the scene, compiled

    def start(self, task: ArmTask) -> tuple[float, ...]:
        """Joint vector at reset, (7,) rad."""
        return self.description.start or task.start

    @property
    def speed_limit(self) -> Array:
        """Largest speed of each joint, (7,) rad/s."""
        return np.array(self.description.speed_limit or sawyer.VELOCITY_LIMIT)

    def arm_spec(self, task: ArmTask, delay: bool = False) -> mujoco.MjSpec:
        """The arm behind the table, ready for a task to add what it needs.

        Args:
            task: its start, clock, and whether something is pushed.
            delay: whether actuators keep a history, so that a domain can delay them.

        Raises:
            UsageError: the start is out of range, the time step does not fit the clock, or there is no finger to push with.
        """
        with blaming(self.path):
            if isinstance(task, PushTask) and not self.names.finger:
                raise UsageError("finger: [] leaves nothing to push with", "name its geoms, or leave `finger` out for ours")
            spec = self.scene.copy()
            self._check_start(task)
            sawyer.set_clock(spec, self._timestep(task.control_period, spec.option.timestep), delay)
        return spec

    def _check_start(self, task: ArmTask) -> None:
        for name, shown, angle in zip(self.names.joints, self.description.joints, self.start(task), strict=True):
            joint = self.model.joint(name)
            low, high = joint.range
            if self.model.jnt_limited[joint.id] and not low <= angle <= high:
                raise UsageError(
                    f"start: joint {shown!r} at {angle:g} rad is outside of its range {low:g} .. {high:g}",
                    "mend `start`" if self.description.start else "the task starts there; give a `start` within the ranges",
                )
        for servo, shown, angle in zip(self.names.servos, self.description.joints, self.start(task), strict=True):
            address = self.model.actuator_ctrladr[self.model.actuator(servo).id]
            low, high = self.model.actuator_ctrlrange[address]
            if self.model.actuator_ctrllimited[address] and not low <= angle <= high:
                raise UsageError(
                    f"start: joint {shown!r} starts at {angle:g} rad, and its servo takes {low:g} .. {high:g} rad only",
                    "mend the servo's ctrlrange, or give a `start` within it",
                )

    def _timestep(self, period: float, own: float) -> float:
        """The time step asked for, or the longest that is not above the model's own; the control period is a multiple of it."""
        steps = period / own
        if abs(steps - round(steps)) < 1e-6 and round(steps) > 0:
            return own
        if self.description.timestep is not None:
            raise UsageError(
                f"timestep: the control period of {period:g} s is not a whole number of time steps of {own:g} s",
                f"for example timestep = {period / math.ceil(steps):.6g}",
            )
        return period / math.ceil(steps)


def load_robot(path: Path) -> Robot:
    """Read a robot file and the model that it names, and check that the skills' joints and gripper are where they expect them.

    Raises:
        UsageError: file or model cannot be read, or do not fit; says which key, and what to do.
    """
    with blaming(path), quietly():
        description = read_description(path)
        scene, names, servos, notes = foreign.build(path.parent / description.model, description)
        _check_timestep(description, scene.option.timestep)
        sawyer.set_clock(scene, description.timestep or scene.option.timestep, delay=False)
        model = compile_model(scene, Path(description.model))
        if _shakes(model, names, servos):
            notes.append(
                f"damping is integrated implicitly: with {_integrator(model)} the servos would shake at this time step"
            )
            scene.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
            model = compile_model(scene, Path(description.model))
        if notes_of_inertia := _steadied(scene, model, names, servos, description.joints):
            notes += notes_of_inertia
            model = compile_model(scene, Path(description.model))
        away = _check_conventions(model, names, description.joints)
        if np.linalg.norm(away) > NOTICED:
            notes.append(f"at the task's start the gripper is {100 * np.linalg.norm(away):.0f} cm from where the source has it")
        notes += _collisions(model, names)
        notes += at_rest(model, names, description)
        fingerprint = _fingerprint(description, scene, model)
    return Robot(
        path=path,
        description=description,
        names=names,
        notes=tuple(notes),
        fingerprint=fingerprint,
        summary=_summary(path, description, model, servos, notes, away),
        scene=scene,
        model=model,
    )


def _check_timestep(description: Description, own: float) -> None:
    if description.timestep is None and not SHORTEST_TIMESTEP <= own <= LONGEST_TIMESTEP:
        raise UsageError(
            f"timestep: the model's own is {own:g} s, from {SHORTEST_TIMESTEP:g} to {LONGEST_TIMESTEP:g} s are taken",
            "give `timestep`, for example 0.002",
        )


def _integrator(model: mujoco.MjModel) -> str:
    return str(mujoco.mjtIntegrator(model.opt.integrator).name).removeprefix("mjINT_").lower()


def _shakes(model: mujoco.MjModel, names: sawyer.Names, servos: list[Servo]) -> bool:
    """Whether the servos' damping, taken explicitly, overshoots in a time step h: the largest rate of M^-1 K_v above 1/h."""
    if _integrator(model) not in ("euler", "rk4"):
        return False
    data = _posed(model, names, ReachTask().start)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    dofs = [model.joint(name).dofadr[0] for name in names.joints]
    rates = np.linalg.eigvals(np.linalg.solve(inertia[np.ix_(dofs, dofs)], np.diag([servo.kv for servo in servos])))
    return bool(model.opt.timestep * np.abs(rates).max() > 1)


def _steadied(
    scene: mujoco.MjSpec, model: mujoco.MjModel, names: sawyer.Names, servos: list[Servo], shown: tuple[str, ...]
) -> list[str]:
    """Give joints that are too light for their servos the inertia of a motor, and note it.

    At its largest torque a servo is switched rather than damped, whatever the integrator: a step h then changes the speed
    by F h / I, which damping answers with up to F only. With an inertia I of k_v h it comes to rest, below it shakes.
    """
    missing = np.zeros(len(servos))
    for index, (servo, inertia) in enumerate(zip(servos, _felt_inertia(model, names), strict=True)):
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


def _felt_inertia(model: mujoco.MjModel, names: sawyer.Names) -> Array:
    """Inertia that the servo of each joint feels at the reach task's start, the other joints free, (7,) kg·m²."""
    data = _posed(model, names, ReachTask().start)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    dofs = [model.joint(name).dofadr[0] for name in names.joints]
    felt: Array = 1 / np.diag(np.linalg.inv(inertia[np.ix_(dofs, dofs)]))
    return felt


def _check_conventions(model: mujoco.MjModel, names: sawyer.Names, joints: tuple[str, ...]) -> Array:
    """Where the gripper is as seen from the source's, (3,) m, with both arms at the start of the reach task."""
    start = ReachTask().start
    here, axes = posture(model, names, start)
    there, expected = posture(sawyer.arm_spec(0.005).compile(), sawyer.NAMES, start)
    cosine = np.einsum("ij,ij->i", axes, expected)
    wrong = np.flatnonzero(cosine < LEAST_COSINE)
    if len(wrong):
        worst = wrong[0]
        raise UsageError(
            f"joints: {joints[worst]!r} turns about {_shown(axes[worst])} at the task's start, where joint {worst + 1} of the "
            f"source turns about {_shown(expected[worst])} ({len(wrong)} of 7 joints differ by more than 45 degrees)",
            "check the order of `joints`, their signs and zero positions, and base.quat",
        )
    away: Array = here - there
    if np.linalg.norm(away) > FARTHEST:
        raise UsageError(
            f"gripper: at the task's start it is at {_shown(here)} m, {np.linalg.norm(away):.2f} m from {_shown(there)} where "
            f"the source has it; at most {FARTHEST:g} m is taken for another build of the same arm",
            "check `gripper`, base.pos, and the zero positions of `joints`",
        )
    return away


def posture(model: mujoco.MjModel, names: sawyer.Names, start: tuple[float, ...]) -> tuple[Array, Array]:
    """Where the gripper is, (3,) m, and about what the joints turn, (7, 3), with the arm at joint angles (7,) rad."""
    data = _posed(model, names, start)
    axes = np.stack([data.xaxis[model.joint(name).id] for name in names.joints])
    return data.site(sawyer.GRIPPER).xpos.copy(), axes


def _posed(model: mujoco.MjModel, names: sawyer.Names, start: tuple[float, ...]) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for name, angle in zip(names.joints, start, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_fwdPosition(model, data)
    return data


def _collisions(model: mujoco.MjModel, names: sawyer.Names) -> list[str]:
    """A note where parts overlap at the reach task's start: joints may be stuck there."""
    data = _posed(model, names, ReachTask().start)
    deep = [contact.geom for contact in data.contact if contact.dist < -OVERLAP]
    pairs = {tuple(model.body(model.geom_bodyid[geom]).name.removeprefix(foreign.PREFIX) for geom in pair) for pair in deep}
    shown = ", ".join(sorted(" and ".join(pair) for pair in pairs))
    return [f"at the task's start these overlap, an <exclude> may be missing: {shown}"] if pairs else []


def at_rest(model: mujoco.MjModel, names: sawyer.Names, description: Description) -> list[str]:
    """A note where the arm, told to stay at its start, hangs below it or comes apart."""
    arms = Arms(model, 1, max(1, round(HELD / model.opt.timestep)), 0.0, 1, names)
    arms.place(np.zeros(1, dtype=int), np.array([description.start or ReachTask().start]))
    told, here = arms.commanded.copy(), arms.gripper_position.copy()
    for _ in range(HELD_STEPS):
        arms.move(np.zeros((1, 7)))
        if arms.unstable().any():
            return ["told to stay at its start the arm comes apart: its gains are too high for the time step"]
    off = np.degrees(np.abs(arms.joint_position - told)[0])
    away = float(np.linalg.norm(arms.gripper_position - here))
    if off.max() < SAGS[0] and away < SAGS[1]:
        return []
    carried = bool(np.all(model.body_gravcomp[model.jnt_bodyid[[model.joint(name).id for name in names.joints]]] >= 1))
    why = "" if carried else ": the controller does not carry its weight, with `gravity_compensation = true` it does"
    worst = description.joints[int(off.argmax())]
    return [f"at rest the arm hangs {100 * away:.1f} cm off where it is told to be, {worst!r} by {off.max():.1f}°{why}"]


def _shown(vector: Array) -> str:
    return "(" + ", ".join(f"{x:.2f}" for x in vector + 0.0) + ")"


def _fingerprint(description: Description, scene: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    later = {"speed_limit"} if description.speed_limit is None else set()  # older files keep their fingerprint
    said = description.model_dump(mode="json", exclude={"model", *later})
    text = re.sub(r'(file|meshdir|texturedir)="[^"]*"', "", scene.to_xml())  # where the files lie does not matter
    digest = hashlib.sha256(json.dumps([said, text], sort_keys=True).encode())
    digest.update(model.mesh_vert.tobytes())  # but what is in them does
    return digest.hexdigest()


def _summary(
    path: Path, description: Description, model: mujoco.MjModel, servos: list[Servo], notes: list[str], away: Array
) -> dict[str, Any]:
    finger = "ours" if description.finger is None else list(description.finger)
    return {
        "file": path.name,
        "model": Path(description.model).name,
        "joints": list(description.joints),
        "servos": [{"kp": servo.kp, "kv": servo.kv} for servo in servos],
        "own_servos": description.gains is None,
        "finger": finger,
        "speed_limit": list(description.speed_limit or sawyer.VELOCITY_LIMIT.tolist()),
        "own_speed_limit": description.speed_limit is not None,
        "timestep": float(model.opt.timestep),
        "integrator": _integrator(model),
        "arm_mass_kg": float(model.body_mass.sum() - model.body("table").mass[0]),
        "gripper_from_source_m": [float(x) for x in away],
        "notes": notes,
    }
