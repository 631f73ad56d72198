"""Wait for a driver to say that it has lost its arm."""

from __future__ import annotations

import time

from skillcli.execution.driver import Driver, DriverError


def failure(driver: Driver) -> DriverError:
    """The error that reading ends with."""
    end = time.monotonic() + 2
    while time.monotonic() < end:
        try:
            driver.read()
        except DriverError as error:
            return error
        time.sleep(0.005)
    raise AssertionError("nothing failed")
