"""Drivers by name. A driver is one module with a function `open_driver`; it is imported when it is used."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import NamedTuple

from skillcli.errors import SkillError, UsageError
from skillcli.execution.driver import Driver
from skillcli.robots.robot import Robot


class DriverModule(NamedTuple):
    """Where a driver is, and what it needs."""

    module: str
    extra: str  # of the package, "" for none
    does: str  # in one line


DRIVERS = {
    "simulation": DriverModule("skillcli.execution.drivers.simulation", "", "our engine in a process of its own, in real time"),
    "franka": DriverModule("skillcli.execution.drivers.franka", "franka", "a Franka arm, by franky over libfranka"),
    "rosbridge": DriverModule("skillcli.execution.drivers.rosbridge", "rosbridge", "an arm on ROS, over a rosbridge server"),
    "lerobot": DriverModule("skillcli.execution.drivers.lerobot", "lerobot", "any robot of LeRobot"),
}


def open_driver(name: str, settings: Mapping[str, object], robot: Robot) -> Driver:
    """Return a driver of an arm, not connected yet.

    Args:
        name: see `DRIVERS`.
        settings: the driver's own, see docs/drivers.md.
        robot: the arm, as its robot file describes it.

    Raises:
        UsageError: there is no such driver, or its settings are wrong.
        SkillError: a package that it needs is not installed.
    """
    if name not in DRIVERS:
        raise UsageError(f"no driver {name!r}", f"drivers: {', '.join(DRIVERS)}")
    known = DRIVERS[name]
    try:
        module = importlib.import_module(known.module)
    except ImportError as error:
        hint = f"pip install 'skillcli[{known.extra}]'" if known.extra else "reinstall skill"
        raise SkillError(f"the driver {name} needs the package {error.name or error}, which is not installed", hint) from None
    driver: Driver = module.open_driver(settings, robot)
    return driver
