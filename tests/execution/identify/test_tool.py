"""Zeros and tool: what measured gripper positions tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from execution.logs import NAMES, PERIOD, SAWYER

from skillcli.execution.identify.kinematics import fit_tool
from skillcli.execution.log import Log
from skillcli.simulation.replay import ForwardKinematics

KINEMATICS = ForwardKinematics(SAWYER)


def test_zeros_and_tool_are_found_from_gripper_positions_and_what_does_not_move_the_gripper_stays() -> None:
    rng = np.random.default_rng(0)
    angles = np.array(SAWYER.home) + rng.uniform(-0.6, 0.6, (200, 7))
    zero, tool = np.array([0.02, -0.01, 0.015, 0, -0.02, 0.01, 0]), np.array([0.0, 0.0, -0.15])
    place, axes = KINEMATICS.frames(angles - zero)
    measured = place + axes @ tool + 0.001 * rng.standard_normal((200, 3))
    log = Log(NAMES, PERIOD * np.arange(200), angles, angles, False, gripper_position=measured)
    found = fit_tool(KINEMATICS, log)
    assert found is not None
    np.testing.assert_allclose(found.zero, zero, atol=0.002)
    np.testing.assert_allclose(found.tool, tool, atol=0.001)
    assert found.noise == pytest.approx(0.001, rel=0.1)
    # without a tool beside its axis the last joint turns nothing
    assert found.zero_spread[6] == pytest.approx(0.02, rel=0.01) and (found.zero_spread[:6] < 0.003).all()
    assert fit_tool(KINEMATICS, replace(log, gripper_position=None)) is None


def test_the_gripper_of_the_robot_file_is_where_it_says() -> None:
    place, axes = KINEMATICS.frames(np.array([SAWYER.home]))
    np.testing.assert_allclose(place[0], (0.6, 0, 0.25), atol=1e-3)
    assert axes[0, 2, 2] == pytest.approx(-1, abs=1e-3), "it points down"
