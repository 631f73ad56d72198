"""Postures that bring a gripper to a place."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import SAWYER

from skillcli.robots.inverse_kinematics import REACHED, Kinematics
from skillcli.robots.start import POINTS_DOWN, find_start

HOME = np.array(SAWYER.home)


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(SAWYER)


@pytest.mark.parametrize("place", [(0.5, 0.3, 0.15), (0.7, -0.3, 0.3), (0.75, 0.2, 0.03)])
def test_the_gripper_gets_to_its_place_within_the_ranges(kinematics: Kinematics, place: tuple[float, ...]) -> None:
    found = kinematics.solve(np.array(place), HOME, down=True)
    assert found is not None
    at, axis = kinematics.gripper(found.angles)
    assert np.linalg.norm(at - place) < REACHED and -axis[2] == pytest.approx(found.down) and found.down > POINTS_DOWN
    assert (kinematics.low <= found.angles).all() and (found.angles <= kinematics.high).all()
    assert not kinematics.collides(found.angles)


def test_from_where_it_is_the_arm_does_not_move(kinematics: Kinematics) -> None:
    here, _ = kinematics.gripper(HOME)
    found = kinematics.solve(here, HOME)
    assert found is not None and found.angles == pytest.approx(HOME, abs=1e-3)


@pytest.mark.parametrize("place", [(2.0, 0.0, 0.3), (0.6, 0.0, -0.02), (0.0, 0.0, 0.1)])
def test_no_posture_where_the_arm_ends_the_table_is_or_its_base(kinematics: Kinematics, place: tuple[float, ...]) -> None:
    assert kinematics.solve(np.array(place), HOME) is None


def test_a_hand_in_the_table_collides(kinematics: Kinematics) -> None:
    deep = HOME.copy()
    deep[1] += 0.7
    assert kinematics.gripper(deep)[0][2] < -0.02 and kinematics.collides(deep) and not kinematics.collides(HOME)
    assert not kinematics.passes(HOME, deep) and kinematics.passes(HOME, HOME + 0.05)


def test_a_start_points_down_and_reaches_all_places(kinematics: Kinematics) -> None:
    middle = np.array([0.6, 0.0, 0.25])
    places = middle + np.array([[0.1, 0.2, -0.1], [-0.1, -0.2, 0.05]])
    start = find_start(kinematics, middle, places, None)
    assert start is not None
    at, axis = kinematics.gripper(np.array(start))
    assert at == pytest.approx(middle, abs=2e-3) and axis[2] < -POINTS_DOWN
    assert find_start(kinematics, middle, np.array([[3.0, 0.0, 0.2]]), None) is None
    assert find_start(kinematics, middle, places, SAWYER.home) == SAWYER.home
