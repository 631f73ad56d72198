"""The driver `simulation`: what every driver must do, and that its arm moves as an episode of `transfer-eval` does."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from execution.conformance import DriverConformance

from skillcli.execution.driver import Driver
from skillcli.execution.drivers import open_driver
from skillcli.robots.robot import load_robot

pytestmark = pytest.mark.real_time  # a process of its own

SAWYER = tuple(f"right_j{joint}" for joint in range(7))


class TestSimulationDriver(DriverConformance):
    names = SAWYER

    @pytest.fixture
    def driver(self) -> Iterator[Driver]:
        yield open_driver("simulation", {}, load_robot("sawyer"))
