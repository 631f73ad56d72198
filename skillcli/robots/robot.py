"""A robot as a value: read from a robot file, bundled or of a user, and ready to stand in a scene."""

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
    find_robot_file,
    read_description,
)
from skillcli.robots.mjcf import compile_model, find_model, quietly
from skillcli.robots.scene import Names, add_table, fingerprint, set_clock
from skillcli.robots.servos import Servo
from skillcli.trajectories import Array

TRIED_TIMESTEP = 0.005  # s, of a model that is taken as it is, until a task sets its own


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of n joints with its scene.

    Attributes:
        name: as a recipe names it, or the name of its file.
        path: of the robot file.
        description: what it says.
        names: what the arm calls its parts.
        home: joint vector at reset where no task says otherwise, (n,) rad.
        speed_limit: largest speed of each joint, (n,) rad/s; infinite where its file does not say.
        workspace: where the finger can be.
        notes: what was left out of the model, and other things worth knowing.
        fingerprint: SHA-256 over what the robot file says and the model that came of it, whatever the folder.
        summary: JSON-able, for the record.
        scene: the arm behind our table; a task works on a copy.
        model: the scene, compiled.
    """

    name: str
    path: Path
    description: Description
    names: Names
    home: tuple[float, ...]
    speed_limit: Array
    workspace: Workspace
    notes: tuple[str, ...]
    fingerprint: str
    summary: dict[str, Any]
    scene: mujoco.MjSpec
    model: mujoco.MjModel

    @property
    def joint_count(self) -> int:
        """How many joints the arm has, n."""
        return len(self.names.joints)

    @property
    def as_source(self) -> match.Source:
        """What another arm is compared with."""
        return match.Source(self.name, self.model, self.names, self.home)

    def start(self, task: str) -> tuple[float, ...]:
        """Joint vector at reset for a task, (n,) rad."""
        return self.description.starts.get(task, self.home)

    def arm_spec(self, start: tuple[float, ...], timestep: float, period: float, delay: bool = False) -> mujoco.MjSpec:
        """The arm behind the table, ready for a task to add what it needs.

        Args:
            start: joint vector at reset, (n,) rad.
            timestep: that the task asks for, s; a robot whose own is shorter keeps it.
            period: between two commands, s.
            delay: whether actuators keep a history, so that a domain can delay them.

        Raises:
            UsageError: the start is out of range, or the time step does not fit the clock.
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
        """Refuse a robot that has nothing to push with.

        Raises:
            UsageError: its file says that nothing pushes.
        """
        if not self.names.finger:
            with blaming(self.path):
                raise UsageError("finger: [] leaves nothing to push with", "name its geoms, or leave `finger` out for ours")

    def check_start(self, start: tuple[float, ...]) -> None:
        """Refuse a start (n,) rad that is not one of this arm.

        Raises:
            UsageError: another number of angles, or one out of the range of its joint or servo.
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
                    "mend `start`" if self.description.start else "the task starts there; give a `start` within the ranges",
                )
        for servo, joint_name, angle in zip(self.names.servos, shown, start, strict=True):
            address = self.model.actuator_ctrladr[self.model.actuator(servo).id]
            low, high = self.model.actuator_ctrlrange[address]
            if self.model.actuator_ctrllimited[address] and not low <= angle <= high:
                raise UsageError(
                    f"start: joint {joint_name!r} starts at {angle:g} rad, and its servo takes {low:g} .. {high:g} rad only",
                    "mend the servo's ctrlrange, or give a `start` within it",
                )

    def _timestep(self, period: float, own: float) -> float:
        """The robot's own, or the longest that is not above it; the control period is a multiple of it."""
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
    """A bundled robot by its name, or one of a robot file by its path.

    Raises:
        UsageError: there is none, or file or model cannot be read, or do not fit; says which key, and what to do.
    """
    path = find_robot_file(which)
    if path is None:
        return _bundled(str(which))
    return build_robot(path, path.stem)


def load_target(which: str | Path, source: Robot) -> Robot:
    """A robot that is to play the skills of another one; see `load_robot`.

    Raises:
        UsageError: as for `load_robot`; or it is another arm, or its joints are ordered or turned otherwise.
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
    """Read a robot file and the model that it names.

    Args:
        path: of the file.
        name: of the robot.
        source: the robot whose skills it is to play; it must be built alike, and takes over what its own file does not say.

    Raises:
        UsageError: file or model cannot be read, or do not fit.
    """
    with blaming(path), quietly():
        return build_described(path, name, read_description(path), source)


def build_described(path: Path, name: str, description: Description, source: Robot | None = None) -> Robot:
    """What `build_robot` makes of a description that is, or could be, in the file at `path`."""
    if description.verbatim:
        return _taken_as_it_is(path, name, description, source)
    return _imported(path, name, description, source)


def _taken_as_it_is(path: Path, name: str, description: Description, source: Robot | None) -> Robot:
    scene = mujoco.MjSpec.from_file(str(find_model(path.parent, description.model)))
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
        workspace=description.workspace or posture.workspace(model, names),
        notes=tuple(notes),
        fingerprint=fingerprint(scene),
        summary={"file": path.name, "model": Path(description.model).name, "joints": list(description.joints), "notes": notes},
        scene=scene,
        model=model,
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
        workspace=description.workspace or posture.workspace(model, names),
        notes=tuple(notes),
        fingerprint=_fingerprint(description, scene, model),
        summary=_summary(path, description, model, servos, notes, away, source),
        scene=scene,
        model=model,
    )


def _speed_limit(description: Description, source: Robot | None) -> Array:
    if description.speed_limit is not None:
        return np.array(description.speed_limit)
    return source.speed_limit if source is not None else np.full(len(description.joints), np.inf)


def _check_timestep(description: Description, own: float) -> None:
    if description.timestep is None and not SHORTEST_TIMESTEP <= own <= LONGEST_TIMESTEP:
        raise UsageError(
            f"timestep: the model's own is {own:g} s, from {SHORTEST_TIMESTEP:g} to {LONGEST_TIMESTEP:g} s are taken",
            "give `timestep`, for example 0.002",
        )


def _integrator(model: mujoco.MjModel) -> str:
    return str(mujoco.mjtIntegrator(model.opt.integrator).name).removeprefix("mjINT_").lower()


_LATER = ("description", "verbatim", "starts", "speed_limit", "workspace")  # keys that older files do not have


def _fingerprint(description: Description, scene: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    later = {key for key in _LATER if key not in description.model_fields_set}  # older files keep their fingerprint
    said = description.model_dump(mode="json", exclude={"model", *later})
    text = re.sub(r'(file|meshdir|texturedir)="[^"]*"', "", scene.to_xml())  # where the files lie does not matter
    digest = hashlib.sha256(json.dumps([said, text], sort_keys=True).encode())
    digest.update(model.mesh_vert.tobytes())  # but what is in them does
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
