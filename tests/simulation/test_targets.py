"""Where commanded targets may be, and how a control step moves them."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import SAWYER

from skillcli.robots.posture import joint_ranges
from skillcli.robots.robot import load_robot
from skillcli.robots.scene import LIMIT_MARGIN
from skillcli.simulation.targets import command_range, next_target

LOW, HIGH = np.array([-1.0, -1.0]), np.array([1.0, np.inf])


@pytest.mark.parametrize(
    ("commanded", "increment", "measured", "wanted"),
    [
        ([0.1, 0.2], [0.04, -0.04], [0.1, 0.2], [0.14, 0.16]),
        ([0.19, 0.0], [0.04, -0.04], [0.0, 0.19], [0.2, -0.01]),  # the first would lead its joint by 0.23
        ([0.99, 5.0], [0.04, 0.04], [0.98, 5.0], [1.0, 5.04]),  # the first ends, the second has no end
        ([0.5, 0.0], [0.0, 0.0], [0.0, 0.0], [0.2, 0.0]),  # an arm that is pushed takes its target along
    ],
)
def test_a_target_moves_as_far_as_it_may(
    commanded: list[float], increment: list[float], measured: list[float], wanted: list[float]
) -> None:
    target = next_target(*(np.array([row]) for row in (commanded, increment, measured)), LOW, HIGH, 0.2)
    assert target[0] == pytest.approx(wanted, abs=1e-12)


def test_targets_stop_inside_the_joint_range_and_the_range_of_the_servo() -> None:
    ranges, allowed = joint_ranges(SAWYER.model, SAWYER.names.joints), command_range(SAWYER.model, SAWYER.names)
    assert allowed[:, 0] == pytest.approx(ranges[:, 0] + LIMIT_MARGIN)
    assert allowed[:, 1] == pytest.approx(ranges[:, 1] - LIMIT_MARGIN)
    hobby = load_robot("so101")
    allowed = command_range(hobby.model, hobby.names)
    servo = hobby.model.actuator_ctrlrange[[hobby.model.actuator(name).id for name in hobby.names.servos]]
    assert (allowed[:, 0] >= servo[:, 0]).all() and (allowed[:, 1] <= servo[:, 1]).all()
