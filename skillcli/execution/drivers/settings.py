"""How the settings of a driver are read, and what those of every real arm's driver have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from pydantic import ValidationError

from skillcli.config.base import Section, value
from skillcli.config.explain import complaint
from skillcli.errors import UsageError
from skillcli.robots.robot import Robot


class ArmSettings(Section):
    """Settings of a driver of a real arm."""

    timeout: float = value(5.0, "longest wait for the connection, then for the first reading", "s", gt=0, le=120)


class NamedSettings(ArmSettings):
    """Settings of a driver whose arm has names for its joints."""

    joints: tuple[str, ...] = value((), "what the arm calls its joints, in the robot file's order; by default as that", "")


Settings = TypeVar("Settings", bound=ArmSettings)
Read = TypeVar("Read", bound=Section)


def validated(kind: type[Read], given: Mapping[str, object], driver: str, page: str) -> Read:
    """Validate the settings of a driver.

    Args:
        kind: what they are to be.
        given: as a TOML file holds them.
        driver: its name, for the error.
        page: that explains them.

    Raises:
        UsageError: a key is unknown, or a value is invalid.
    """
    try:
        return kind.model_validate(dict(given))
    except ValidationError as error:
        first = complaint(error, kind)
        known = first.known or tuple(kind.model_fields)
        raise UsageError(
            f"driver {driver}: {first.key}{first.entry}: {first.said}", f"keys: {', '.join(known)}; {page} explains them"
        ) from None


def read_settings(kind: type[Settings], given: Mapping[str, object], driver: str, robot: Robot) -> Settings:
    """Validate the settings of a driver, and fill in the names of the joints if the arm has some.

    Args:
        kind: what they are to be.
        given: as a TOML file holds them.
        driver: its name, for the error.
        robot: the arm.

    Raises:
        UsageError: a key is unknown, a value is invalid, or the number of joints is not that of the robot file.
    """
    settings = validated(kind, given, driver, f"docs/driver-{driver}.md")
    if not isinstance(settings, NamedSettings):
        return settings
    names = settings.joints or tuple(robot.description.joints)
    check_length("joints", names, driver, robot)
    if len(set(names)) != len(names):
        raise UsageError(f"driver {driver}: joints: expected different names, got {', '.join(names)}", "name each joint once")
    return settings.model_copy(update={"joints": names})


def check_length(key: str, given: tuple[object, ...], driver: str, robot: Robot) -> None:
    """Refuse a list that has not one entry for each joint of the robot file.

    Raises:
        UsageError: it has more or fewer.
    """
    if len(given) != robot.joint_count:
        raise UsageError(
            f"driver {driver}: {key}: expected {robot.joint_count} entries, one for each joint of {robot.name!r}, "
            f"got {len(given)}",
            f"in this order: {', '.join(robot.description.joints)}",
        )
