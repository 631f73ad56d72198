"""Read robot files: small TOML files beside a model, bounded and checked without opening the model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from pydantic import ValidationError, ValidationInfo, field_validator, model_validator

from skillcli.config.base import Joints, Section, Vector3, value
from skillcli.config.explain import complaint
from skillcli.config.toml_file import read_toml
from skillcli.errors import UsageError
from skillcli.paths import expanded

Quaternion = tuple[float, float, float, float]
DEFAULT_ROBOT = "sawyer"  # of a recipe; the defaults of the tasks lie around it
FEWEST, MOST = 4, 8  # joints of an arm
SHORTEST_TIMESTEP, LONGEST_TIMESTEP = 1e-4, 0.02  # s
FARTHEST = 10.0  # m, of any offset: beyond, the arm is nowhere near the table
_EXAMPLE = "docs/robots.md has an example"


class Frame(Section):
    """A pose in a frame that the context names."""

    pos: Vector3 = value((0, 0, 0), "offset", "m")
    quat: Quaternion = value((1, 0, 0, 0), "orientation, w x y z; any length but zero", "")

    @model_validator(mode="after")
    def _turns(self) -> Frame:
        if not any(self.quat):
            raise ValueError("quat must not be all zeros")
        if max(map(abs, self.pos)) > FARTHEST:
            raise ValueError(f"pos must lie within {FARTHEST:g} m, got {list(self.pos)}")
        return self


class Gripper(Frame):
    """Where our finger is mounted, or where the model's own ends: a site, or a pose on a body. z points out of the hand."""

    site: str = value("", "a site of the model; or else", "")
    body: str = value("", "a body of the model, with pos and quat in its frame", "")

    @model_validator(mode="after")
    def _one_of_them(self) -> Gripper:
        if bool(self.site) == bool(self.body):
            raise ValueError('give either site = "NAME", or body = "NAME" with pos and quat')
        if self.site and {"pos", "quat"} & self.model_fields_set:
            raise ValueError("a site has its own pose: pos and quat go with body")
        return self


class Gains(Section):
    """Position control of the joints, for a model without position servos; replaces those that it has."""

    kp: Joints = value(..., "stiffness of each joint", "N·m/rad")
    kv: Joints = value(..., "damping of each joint", "N·m·s/rad")
    force: Joints | None = value(None, "largest torque of each joint; by default that of the model's motor", "N·m")

    @model_validator(mode="after")
    def _positive(self) -> Gains:
        if min(self.kp) <= 0 or min(self.kv) <= 0 or (self.force is not None and min(self.force) <= 0):
            raise ValueError("every gain and force must be positive")
        return self


class Hand(Section):
    """A hand whose two fingers slide towards each other, for tasks that grasp; other tasks keep it closed."""

    joints: tuple[str, str] = value(..., "the slide joint of each finger, zero where the fingers meet", "")
    actuators: tuple[str, str] | None = value(None, "the position servo of each finger; by default the one on its joint")
    widest: float = value(..., "between the open fingers", "m", gt=0, le=1)
    force: float = value(
        ..., "largest lasting force with which each finger presses, of the hand's own data sheet", "N", gt=0, le=1e4
    )
    speed: float = value(..., "largest speed at which the width between the fingers changes, of the same", "m/s", gt=0, le=10)


class Workspace(Section):
    """Bounds of where the finger can be; goals outside are refused."""

    shoulder: Vector3 = value(..., "on the axis of the first joint, at the height of the second", "m")
    reach: float = value(..., "no point of the finger is farther from the shoulder", "m", gt=0, le=FARTHEST)
    base_radius: float = value(0.12, "of the column that base and first link fill", "m", ge=0, le=FARTHEST)
    base_height: float = value(0.5, "of that column", "m", ge=0, le=FARTHEST)


class Description(Section):
    """The content of a robot file."""

    description: str = value("", "what this robot is, in one line", "")
    model: str = value(..., "the MJCF file, relative to the robot file", "", min_length=1)
    joints: tuple[str, ...] = value(..., "the arm joints, from the base to the hand", "")
    gripper: Gripper = value(..., "where the finger is mounted, or ends", "")
    finger: tuple[str, ...] | None = value(
        None, "geoms, or bodies with all their geoms, that push; [] for none; without this key ours is mounted at the gripper"
    )
    hand: Hand | None = value(None, "the two fingers of a hand that can grasp", "")
    verbatim: bool = value(
        False,
        "take the model as it is: the arm alone, with a position servo named after each joint, and the site `gripper`",
    )
    gains: Gains | None = value(None, "position control, where the model has torque motors or no actuators", "")
    actuators: tuple[str, ...] | None = value(None, "the actuator of each joint, where a joint has several", "")
    gravity_compensation: bool | None = value(
        None, "whether the controller carries the arm; by default yes with `gains`, else as the model says", strict=True
    )
    start: Joints | None = value(None, "joint vector at reset", "rad")
    starts: dict[str, Joints] = value({}, "joint vector at reset of single tasks, where it is another one", "rad")
    speed_limit: Joints | None = value(None, "largest speed of each joint, of the arm's own data sheet", "rad/s")
    acceleration_limit: Joints | None = value(
        None, "largest acceleration of each joint that an execution asks for, of the arm's own data sheet", "rad/s²"
    )
    timestep: float | None = value(
        None, "of the physics; by default the model's own", "s", ge=SHORTEST_TIMESTEP, le=LONGEST_TIMESTEP, strict=True
    )
    base: Frame = Frame()
    workspace: Workspace | None = value(None, "where the finger can be; by default worked out from the model", "")

    @field_validator("speed_limit", "acceleration_limit")
    @classmethod
    def _positive(cls, given: Joints | None, info: ValidationInfo) -> Joints | None:
        if given is not None and min(given, default=1.0) <= 0:
            raise ValueError(f"every {str(info.field_name).removesuffix('_limit')} must be positive")
        return given

    @field_validator("joints", "actuators")
    @classmethod
    def _different(cls, given: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if given is None:
            return None
        twice = sorted({item for item in given if given.count(item) > 1})
        if twice:
            raise ValueError(f"names {twice[0]!r} more than once")
        return given

    @field_validator("joints")
    @classmethod
    def _an_arm(cls, given: tuple[str, ...]) -> tuple[str, ...]:
        if not FEWEST <= len(given) <= MOST:
            raise ValueError(f"must name {FEWEST} to {MOST}, from the base to the hand, got {len(given)}")
        return given

    @model_validator(mode="after")
    def _one_of_each_joint(self) -> Description:
        given = {"start": self.start, "speed_limit": self.speed_limit, "actuators": self.actuators}
        given["acceleration_limit"] = self.acceleration_limit
        given |= {f"starts.{task}": start for task, start in self.starts.items()}
        if self.gains is not None:
            given |= {"gains.kp": self.gains.kp, "gains.kv": self.gains.kv, "gains.force": self.gains.force}
        for key, values in given.items():
            if values is not None and len(values) != len(self.joints):
                raise ValueError(f"{key}: expected {len(self.joints)} values, one for each joint, got {len(values)}")
        if self.verbatim and (self.gains or self.actuators or self.gravity_compensation is not None):
            raise ValueError("verbatim: the model is taken as it is, so gains, actuators and gravity_compensation say nothing")
        return self


def bundled_robots() -> list[str]:
    """List the names of the robots that come along, sorted."""
    return sorted(path.parent.name for path in Path(__file__).parent.glob("*/*.toml") if path.stem == path.parent.name)


def bundled_file(name: str) -> Path:
    """Return the file of a bundled robot."""
    return Path(__file__).parent / name / f"{name}.toml"


def is_path(which: str) -> bool:
    """Check whether a robot is named by its file: the text ends in .toml or contains a slash."""
    return which.endswith(".toml") or "/" in which or "\\" in which


def find_robot_file(which: str | Path) -> Path | None:
    """Return the path of a robot file, None for a bundled robot.

    Raises:
        UsageError: the text is neither a path nor the name of a bundled robot.
    """
    text = str(which)
    if text in bundled_robots():
        return None
    if isinstance(which, Path) or is_path(text):
        return expanded(which)
    known = ", ".join(bundled_robots())
    raise UsageError(f"no robot {text!r}", f"robots: {known}; or give the path of a robot file (docs/robots.md)")


@cache
def _bundled(name: str) -> Description:
    return read_description(bundled_file(name))


def describe_robot(which: str) -> Description:
    """Read the file of a robot by name or path, without opening its model.

    Raises:
        UsageError: there is no such robot, or its file is invalid.
    """
    path = find_robot_file(which)
    if path is None:
        return _bundled(which)
    with blaming(path):
        return read_description(path)


def start_of(which: str, task: str) -> tuple[float, ...]:
    """Return the joint vector at reset for a task, (n,) rad: from the robot's file, else all zeros."""
    said = describe_robot(which)
    return said.starts.get(task, said.start) or (0.0,) * len(said.joints)


def read_description(path: Path) -> Description:
    """Read a robot file.

    Raises:
        UsageError: the file is missing or not TOML, or has an unknown key or a value out of bounds.
    """
    try:
        content = read_toml(path)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise UsageError("no such file", "a robot is described by a small TOML file; docs/robots.md has an example") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot be read: {error}", "a robot file is TOML; docs/robots.md has an example") from error
    try:
        return Description.model_validate(content)
    except ValidationError as error:
        raise UsageError(*_explained(error)) from error


@contextmanager
def blaming(path: Path) -> Iterator[None]:
    """Name the robot file in every error."""
    try:
        yield
    except UsageError as error:
        raise UsageError(f"robot {path}: {error.message}", error.hint) from error


def _explained(error: ValidationError) -> tuple[str, str]:
    """Return one line and a hint for the first error."""
    found = complaint(error, Description)
    if found.kind == "unknown":
        return f"unknown key {found.key!r}", f"keys here: {', '.join(found.known)}"
    if found.kind == "missing":
        return f"{found.key!r} is missing", _EXAMPLE
    return (f"{found.key}{found.entry}: " if found.keys else "") + found.said, _EXAMPLE
