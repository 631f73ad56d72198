"""Chains of holds and blends, and the calibration by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.composition.interpolation import Calibration, all_pairs, chain
from skillcli.metrics import interpolation_calibration

NAMES = ("1", "2", "3", "4")
A, B = np.array([1.0, 0, 0]), np.array([3.0, 0, 0])
SHARE = np.array([0, 0.25, 0.5, 0.75, 1])


def ends(*fraction: float, off: float = 0.0) -> np.ndarray:
    return np.array([[1 + 2 * f, off, 0] for f in fraction])


def test_a_chain_holds_blends_and_holds() -> None:
    entries = chain([2, 0, 3], NAMES, hold=1.0, blend=0.5)
    assert [(entry.text, entry.seconds) for entry in entries] == [("3", 1), ("3~1", 0.5), ("1", 1), ("1~4", 0.5), ("4", 1)]
    assert entries[1].segment(np.eye(4), 0.05).until is not None and entries[2].segment(np.eye(4), 0.05).skill == 0


def test_a_faithful_motion_has_no_error() -> None:
    found = interpolation_calibration(ends(*SHARE), A, B, SHARE)
    assert found == {"error": 0, "error_at_half": 0, "monotone": True, "off_line_m": 0}


def test_the_error_is_measured_along_the_line_and_the_rest_beside_it() -> None:
    found = interpolation_calibration(ends(0, 0.05, 0.2, 0.75, 1, off=0.3), A, B, SHARE)
    assert found["error"] == pytest.approx((0.2 + 0.3) / 5) and found["error_at_half"] == pytest.approx(0.3)
    assert found["off_line_m"] == pytest.approx(0.3) and found["monotone"] is True


def test_half_way_is_found_between_two_shares_where_it_is_none_of_them() -> None:
    found = interpolation_calibration(ends(0, 0.2, 0.6, 1), A, B, np.array([0, 1 / 3, 2 / 3, 1]))
    assert found["error_at_half"] == pytest.approx(0.1)


@pytest.mark.parametrize(("fraction", "monotone"), [((0, 0.5, 0.495, 0.7, 1), True), ((0, 0.5, 0.4, 0.7, 1), False)])
def test_a_motion_that_falls_back_is_not_monotone(fraction: tuple[float, ...], monotone: bool) -> None:
    assert interpolation_calibration(ends(*fraction), A, B, SHARE)["monotone"] is monotone


def test_the_report_gives_every_pair_and_the_neighbours_apart() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    pair, share = np.array(all_pairs(4)), np.array([0, 0.5, 1])
    start, end = square[pair[:, 0]][:, None], square[pair[:, 1]][:, None]
    way = start + share[None, :, None] * (end - start)
    diagonal = (np.abs(square[pair[:, 1]] - square[pair[:, 0]]).sum(axis=1) == 2)[:, None, None]
    report = Calibration(pair, share, np.where(diagonal, start, way), square).summary(NAMES)
    assert len(report["pairs"]) == report["pair_count"] == 6 and report["neighbours"]["pair_count"] == 4
    assert report["neighbours"]["mean_error"] == 0 and report["mean_error"] == pytest.approx(2 * 0.5 / 6)
    assert report["mean_error_at_half"] == pytest.approx(2 * 0.5 / 6) and report["monotone_share"] == 1
    first = report["pairs"][0]
    assert (first["from"], first["to"], first["error"], first["neighbours"]) == ("1", "2", 0, True)


def test_without_pairs_there_is_nothing_to_average() -> None:
    report = Calibration(np.zeros((0, 2), dtype=int), SHARE, np.zeros((0, 5, 3)), np.zeros((1, 3))).summary(("1",))
    assert report["pairs"] == [] and report["mean_error"] is None
