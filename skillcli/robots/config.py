"""How another robot is described: a small TOML file beside its MJCF, bounded and checked here without opening the model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationError, field_validator, model_validator

from skillcli.config.base import Joints, Section, Vector3, value
from skillcli.config.explain import complaint
from skillcli.config.toml_file import read_toml
from skillcli.errors import UsageError

Quaternion = tuple[float, float, float, float]
SEVEN = 7
SHORTEST_TIMESTEP, LONGEST_TIMESTEP = 1e-4, 0.02  # s
FARTHEST = 10.0  # m, of any offset: beyond, the arm is nowhere near the table
_EXAMPLE = "docs/robots.md has an example"
OTHER_ARM = "skills are joint motions of the Sawyer and do not carry over to another arm; training on one is not possible yet"


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
    """Where the finger is mounted, or ends where the model has one: a site, or a pose on a body. z points out of the hand."""

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
    """Position control of the seven joints, for a model without position servos; replaces its own where it has them."""

    kp: Joints = value(..., "stiffness of each joint", "N·m/rad")
    kv: Joints = value(..., "damping of each joint", "N·m·s/rad")
    force: Joints | None = value(None, "largest torque of each joint; by default that of the model's motor", "N·m")

    @model_validator(mode="after")
    def _positive(self) -> Gains:
        if min(self.kp) <= 0 or min(self.kv) <= 0 or (self.force is not None and min(self.force) <= 0):
            raise ValueError("every gain and force must be positive")
        return self


class Description(Section):
    """A robot file."""

    model: str = value(..., "the MJCF file, relative to the robot file", "", min_length=1)
    joints: tuple[str, ...] = value(..., "the seven arm joints, from the base to the hand", "")
    gripper: Gripper = value(..., "where the finger is mounted, or ends", "")
    finger: tuple[str, ...] | None = value(
        None, "geoms, or bodies with all their geoms, that push; [] for none; without this key ours is mounted at the gripper"
    )
    gains: Gains | None = value(None, "position control, where the model has torque motors or no actuators", "")
    actuators: tuple[str, ...] | None = value(None, "the actuator of each joint, where a joint has several", "")
    gravity_compensation: bool | None = value(
        None, "whether the controller carries the arm; by default yes with `gains`, else as the model says", strict=True
    )
    start: Joints | None = value(None, "joint vector at reset; by default the task's", "rad")
    speed_limit: Joints | None = value(None, "largest speed of each joint; by default the Sawyer's data sheet", "rad/s")
    timestep: float | None = value(
        None, "of the physics; by default the model's own", "s", ge=SHORTEST_TIMESTEP, le=LONGEST_TIMESTEP, strict=True
    )
    base: Frame = Frame()

    @field_validator("speed_limit")
    @classmethod
    def _positive(cls, given: Joints | None) -> Joints | None:
        if given is not None and min(given) <= 0:
            raise ValueError("every speed must be positive")
        return given

    @field_validator("joints", "actuators")
    @classmethod
    def _seven(cls, given: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if given is None:
            return None
        if len(given) != SEVEN:
            raise ValueError(f"must name seven, from the base to the hand, got {len(given)}")
        twice = sorted({item for item in given if given.count(item) > 1})
        if twice:
            raise ValueError(f"names {twice[0]!r} more than once")
        return given


def read_description(path: Path) -> Description:
    """Read a robot file.

    Raises:
        UsageError: it is not there, is not TOML, has an unknown key or a value out of bounds.
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
    """Say in every error which robot file it is about."""
    try:
        yield
    except UsageError as error:
        raise UsageError(f"robot {path}: {error.message}", error.hint) from error


def _explained(error: ValidationError) -> tuple[str, str]:
    """One line and a hint, for the first complaint."""
    found = complaint(error, Description)
    if found.kind == "unknown":
        return f"unknown key {found.key!r}", f"keys here: {', '.join(found.known)}"
    if found.kind == "missing":
        return f"{found.key!r} is missing", _EXAMPLE
    seven = found.keys[:1] == ("joints",) and found.said.startswith("must name seven")
    hint = f"{_EXAMPLE}; an arm with another number of joints is another arm: {OTHER_ARM}" if seven else _EXAMPLE
    return (f"{found.key}{found.entry}: " if found.keys else "") + found.said, hint
