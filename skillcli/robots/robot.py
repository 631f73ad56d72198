"""Load a robot from its file, bundled or a user's, as a value that is ready for a scene."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots import import_mjcf, match, posture
from skillcli.robots.config import (
    LONGEST_TIMESTEP,
    SHORTEST_TIMESTEP,
    Description,
    Workspace,
    blaming,
    bundled_file,
    bundled_robots,
    describe_robot,
    find_robot_file,
    read_description,
)
from skillcli.robots.mjcf import compile_model, find_model, quietly, read_mjcf
from skillcli.robots.scene import Hand, Names, add_table, fingerprint, set_clock
from skillcli.robots.servos import Servo
from skillcli.robots.two_fingers import find_hand
from skillcli.trajectories import Array

TRIED_TIMESTEP = 0.005  # s, of a `verbatim` model until a task sets its own


SPEED_SHARE = 0.95  # share of a joint's largest speed that commands may ask for


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of n joints with its scene.

    Attributes:
        name: as a recipe names it, or the name of its file.
        path: of the robot file.
        description: what it says.
        names: what the arm calls its parts.
        home: default joint vector at reset, (n,) rad.
        speed_limit: largest speed of each joint, (n,) rad/s; infinite if its file leaves it out.
        acceleration_limit: largest acceleration of each joint, (n,) rad/s²; infinite if its file leaves it out.
        workspace: where the finger can be.
        notes: what was changed or left out in the model, one line each.
        fingerprint: SHA-256 over the robot file and the imported model, without paths.
        summary: JSON-able description, stored with results.
        scene: arm and table; a task works on a copy.
        model: the scene, compiled.
        hand: its two fingers, None without a hand that can grasp.
    """

    name: str
    path: Path
    description: Description
    names: Names
    home: tuple[float, ...]
    speed_limit: Array
    acceleration_limit: Array
    workspace: Workspace
    notes: tuple[str, ...]
    fingerprint: str
    summary: dict[str, Any]
    scene: mujoco.MjSpec
    model: mujoco.MjModel
    hand: Hand | None = None

    @property
    def which(self) -> str:
        """Return how to ask for it: the name of a bundled robot, else the whole path of its file."""
        return self.name if self.path == bundled_file(self.name) else str(self.path.absolute())

    @property
    def joint_count(self) -> int:
        """Return the number of joints, n."""
        return len(self.names.joints)

    @property
    def as_source(self) -> match.Source:
        """Return the parts that another arm is compared with."""
        return match.Source(self.name, self.model, self.names, self.home)

    def start(self, task: str) -> tuple[float, ...]:
        """Return the joint vector at reset for a task, (n,) rad."""
        return self.description.starts.get(task, self.home)

    def largest_action(self, usual: float, period: float) -> float:
        """Return the largest joint increment per control step, rad: the usual one, or what the slowest joint can follow."""
        slowest = float(np.min(self.speed_limit))
        return min(usual, float(np.floor(SPEED_SHARE * slowest * period * 1000) / 1000)) if np.isfinite(slowest) else usual

    def arm_spec(self, start: tuple[float, ...], timestep: float, period: float, delay: bool = False) -> mujoco.MjSpec:
        """Copy arm and table for a task to add its parts.

        Args:
            start: joint vector at reset, (n,) rad.
            timestep: of the task, s; a robot with a shorter one keeps its own.
            period: between two commands, s.
            delay: whether actuators keep a history of commands, so that a domain can delay them.

        Raises:
            UsageError: the start is out of range, or the control period is not a multiple of the time step.
        """
        with blaming(self.path):
            spec = self.scene.copy()
            self.check_start(start)
            own = self.description.timestep
            free = own is None and self.description.verbatim
            step = timestep if free else min(timestep, self._timestep(period, own or spec.option.timestep))
            set_clock(spec, self.names.servos, step, delay)
        return spec

    def check_finger(self) -> None:
        """Refuse a robot without a finger.

        Raises:
            UsageError: its file has an empty `finger`.
        """
        if not self.names.finger:
            with blaming(self.path):
                raise UsageError("finger: [] leaves nothing to push with", "name its geoms, or leave `finger` out for ours")

    def graspers(self) -> Hand:
        """Return the two fingers.

        Raises:
            UsageError: the robot has no hand that can grasp.
        """
        if self.hand is None:
            able = ", ".join(name for name in bundled_robots() if describe_robot(name).hand)
            raise UsageError(
                f"robot {self.which} has no hand that can grasp: its file has no section [hand]",
                f"take one that has: {able}; or describe the two fingers there (docs/robot-files.md)",
            )
        return self.hand

    def check_start(self, start: tuple[float, ...]) -> None:
        """Refuse a start (n,) rad that does not fit this arm.

        Raises:
            UsageError: the number of angles is wrong, or an angle is out of the range of its joint or servo.
        """
        shown = self.description.joints
        if len(start) != len(shown):
            raise UsageError(
                f"start: the arm has {len(shown)} joints, the start {len(start)} angles",
                "give one angle for each joint, in rad",
            )
        for name, joint_name, angle in zip(self.names.joints, shown, start, strict=True):
            joint = self.model.joint(name)
            low, high = joint.range
            if self.model.jnt_limited[joint.id] and not low <= angle <= high:
                raise UsageError(
                    f"start: joint {joint_name!r} at {angle:g} rad is outside of its range {low:g} .. {high:g}",
                    "fix `start`" if self.description.start else "the task starts there; give a `start` within the ranges",
                )
        for servo, joint_name, angle in zip(self.names.servos, shown, start, strict=True):
            address = self.model.actuator_ctrladr[self.model.actuator(servo).id]
            low, high = self.model.actuator_ctrlrange[address]
            if self.model.actuator_ctrllimited[address] and not low <= angle <= high:
                raise UsageError(
                    f"start: joint {joint_name!r} starts at {angle:g} rad, and its servo takes {low:g} .. {high:g} rad only",
                    "fix the servo's ctrlrange, or give a `start` within it",
                )

    def _timestep(self, period: float, own: float) -> float:
        """Return the robot's own time step, s, or the longest one below it that divides the control period."""
        steps = period / own
        if abs(steps - round(steps)) < 1e-6 and round(steps) > 0:
            return own
        if self.description.timestep is not None:
            raise UsageError(
                f"timestep: the control period of {period:g} s is not a whole number of time steps of {own:g} s",
                f"for example timestep = {period / math.ceil(steps):.6g}",
            )
        return period / math.ceil(steps)


def load_robot(which: str | Path) -> Robot:
    """Load a bundled robot by name, or another one by the path of its file.

    Raises:
        UsageError: there is no such robot, or file or model are invalid or do not fit; names the key, and what to do.
    """
    path = find_robot_file(which)
    if path is None:
        return _bundled(str(which))
    return build_robot(path, path.stem)


def load_target(which: str | Path, source: Robot) -> Robot:
    """Load a robot that is to play the skills of another one; see `load_robot`.

    Raises:
        UsageError: as `load_robot`; also if it is another arm, or order or direction of its joints differ.
    """
    path = find_robot_file(which)
    if path is None and which == source.name:
        return source
    if path is None:
        path = bundled_file(str(which))
    return build_robot(path, path.stem, source)


@cache
def _bundled(name: str) -> Robot:
    return build_robot(bundled_file(name), name)


def build_robot(path: Path, name: str, source: Robot | None = None) -> Robot:
    """Read a robot file and import its model.

    Args:
        path: of the file.
        name: of the robot.
        source: the robot whose skills it is to play, of the same build; its start and limits stand in for missing ones.

    Raises:
        UsageError: file or model are invalid, or do not fit.
    """
    with blaming(path), quietly():
        return build_described(path, name, read_description(path), source)


def build_described(path: Path, name: str, description: Description, source: Robot | None = None) -> Robot:
    """Import the model of a description, which need not be in the file at `path` yet; see `build_robot`."""
    if description.verbatim:
        return _taken_as_it_is(path, name, description, source)
    return _imported(path, name, description, source)


def _taken_as_it_is(path: Path, name: str, description: Description, source: Robot | None) -> Robot:
    scene = read_mjcf(find_model(path.parent, description.model))
    add_table(scene)
    set_clock(scene, description.joints, description.timestep or TRIED_TIMESTEP, delay=False)
    model = compile_model(scene, Path(description.model))
    names = Names(description.joints, description.joints, tuple(description.finger or ()))
    notes: list[str] = []
    if source is not None:
        match.check_build(model, description.joints, source.as_source)
        _, notes = match.check_conventions(model, names, description.joints, source.as_source)
    return Robot(
        name=name,
        path=path,
        description=description,
        names=names,
        home=description.start or (0.0,) * len(names.joints),
        speed_limit=_speed_limit(description, None),
        acceleration_limit=_acceleration_limit(description, None),
        workspace=description.workspace or posture.workspace(model, names),
        notes=tuple(notes),
        fingerprint=fingerprint(scene),
        summary={"file": path.name, "model": Path(description.model).name, "joints": list(description.joints), "notes": notes},
        scene=scene,
        model=model,
        hand=find_hand(model, description, prefix=""),
    )


def _imported(path: Path, name: str, description: Description, source: Robot | None) -> Robot:
    scene, names, servos, notes = import_mjcf.build(
        find_model(path.parent, description.model), description, source.as_source if source else None
    )
    _check_timestep(description, scene.option.timestep)
    set_clock(scene, names.servos, description.timestep or scene.option.timestep, delay=False)
    model = compile_model(scene, Path(description.model))
    if parted := posture.part_neighbours(scene, model, names, import_mjcf.PREFIX):
        notes += parted
        model = compile_model(scene, Path(description.model))
    home = description.start or (source.home if source else (0.0,) * len(names.joints))
    reference = source.home if source else home
    if posture.shakes(model, names, servos, reference):
        notes.append(f"damping is integrated implicitly: with {_integrator(model)} the servos would shake at this time step")
        scene.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model = compile_model(scene, Path(description.model))
    if notes_of_inertia := posture.steady(scene, model, names, servos, description.joints, reference):
        notes += notes_of_inertia
        model = compile_model(scene, Path(description.model))
    away = np.zeros(3)
    if source is not None:
        away, noted = match.check_conventions(model, names, description.joints, source.as_source)
        notes += noted
    notes += posture.collisions(model, names, reference, import_mjcf.PREFIX)
    notes += posture.at_rest(model, names, description.joints, home)
    return Robot(
        name=name,
        path=path,
        description=description,
        names=names,
        home=home,
        speed_limit=_speed_limit(description, source),
        acceleration_limit=_acceleration_limit(description, source),
        workspace=description.workspace or posture.workspace(model, names),
        notes=tuple(notes),
        fingerprint=_fingerprint(description, scene, model),
        summary=_summary(path, description, model, servos, notes, away, source),
        scene=scene,
        model=model,
        hand=find_hand(model, description, import_mjcf.PREFIX),
    )


def _speed_limit(description: Description, source: Robot | None) -> Array:
    if description.speed_limit is not None:
        return np.array(description.speed_limit)
    return source.speed_limit if source is not None else np.full(len(description.joints), np.inf)


def _acceleration_limit(description: Description, source: Robot | None) -> Array:
    if description.acceleration_limit is not None:
        return np.array(description.acceleration_limit)
    return source.acceleration_limit if source is not None else np.full(len(description.joints), np.inf)


def _check_timestep(description: Description, own: float) -> None:
    if description.timestep is None and not SHORTEST_TIMESTEP <= own <= LONGEST_TIMESTEP:
        raise UsageError(
            f"timestep: the model's own is {own:g} s, from {SHORTEST_TIMESTEP:g} to {LONGEST_TIMESTEP:g} s are taken",
            "give `timestep`, for example 0.002",
        )


def _integrator(model: mujoco.MjModel) -> str:
    return str(mujoco.mjtIntegrator(model.opt.integrator).name).removeprefix("mjINT_").lower()


_LATER = ("description", "verbatim", "starts", "speed_limit", "workspace")  # keys added later


def _fingerprint(description: Description, scene: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    later = {key for key in _LATER if key not in description.model_fields_set}  # older files keep their fingerprint
    # What only an execution keeps to changes nothing of what is trained and simulated. A hand changes only the scenes of tasks
    # that grasp, and these have a hash of their own.
    said = description.model_dump(mode="json", exclude={"model", "acceleration_limit", "hand", *later})
    text = re.sub(r'(file|meshdir|texturedir)="[^"]*"', "", scene.to_xml())  # paths do not count
    digest = hashlib.sha256(json.dumps([said, text], sort_keys=True).encode())
    digest.update(model.mesh_vert.tobytes())  # contents do
    return digest.hexdigest()


def _summary(
    path: Path,
    description: Description,
    model: mujoco.MjModel,
    servos: list[Servo],
    notes: list[str],
    away: Array,
    source: Robot | None,
) -> dict[str, Any]:
    finger = "ours" if description.finger is None else list(description.finger)
    limit = _speed_limit(description, source)
    return {
        "file": path.name,
        "model": Path(description.model).name,
        "joints": list(description.joints),
        "servos": [{"kp": servo.kp, "kv": servo.kv} for servo in servos],
        "own_servos": description.gains is None,
        "finger": finger,
        "speed_limit": limit.tolist() if np.isfinite(limit).all() else None,
        "own_speed_limit": description.speed_limit is not None,
        "timestep": float(model.opt.timestep),
        "integrator": _integrator(model),
        "arm_mass_kg": float(model.body_mass.sum() - model.body("table").mass[0]),
        "gripper_from_source_m": [float(x) for x in away],
        "notes": notes,
    }
