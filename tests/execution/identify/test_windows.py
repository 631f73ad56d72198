"""Windows of a log: which rows they predict, what is held out, and what counts."""

from __future__ import annotations

import numpy as np
from execution.logs import PERIOD, small_log

from skillcli.execution.identify.windows import held_out, how_held_out, short_windows, stretches

ALL = np.ones(100, dtype=bool)


def test_windows_follow_each_other_and_none_crosses_from_one_episode_to_the_next() -> None:
    windows = short_windows(small_log((4, 3)), 2, ALL)
    assert windows.first.tolist() == [0, 4] and windows.rows.tolist() == [[1, 2], [5, 6]] and windows.counted.all()
    assert short_windows(small_log((4, 3)), 1, ALL).rows.ravel().tolist() == [1, 2, 3, 5, 6]
    assert short_windows(small_log((4, 3)), 4, ALL).first.tolist() == []


def test_a_window_is_taken_if_all_that_it_predicts_is_wanted() -> None:
    wanted = np.array([False, True, True, False, False, True, True])
    assert short_windows(small_log((7,)), 2, wanted).first.tolist() == [0, 4], "row 0 and row 4 are where they begin"


def test_windows_may_begin_earlier_than_they_count() -> None:
    wanted = np.array([False] * 5 + [True] * 4)
    windows = short_windows(small_log((9,)), 2, wanted, run_in=3)  # would begin at 0, 2, 4, 6: the first two have no run-in
    assert windows.first.tolist() == [1, 3] and windows.length == 5
    assert windows.rows[windows.counted].tolist() == [5, 6, 7, 8]


def test_of_few_episodes_every_fourth_half_second_is_held_out() -> None:
    log = small_log((42, 35))  # windows of 10 steps predict rows 1..10, 11..20, 21..30, 31..40
    assert np.flatnonzero(held_out(log)).tolist() == [*range(31, 41), *range(42 + 31, 42 + 35)]
    assert how_held_out(log) == "every fourth half second"
    assert len(short_windows(log, 10, ~held_out(log)).first) == 6 and short_windows(log, 10, held_out(log)).first.tolist() == [
        30
    ]


def test_of_many_episodes_every_third_is_held_out() -> None:
    log = small_log((3, 4, 5, 3, 3, 2))
    assert np.flatnonzero(held_out(log)).tolist() == [7, 8, 9, 10, 11, 18, 19] and how_held_out(log) == "every third episode"


def test_the_end_of_a_very_short_log_is_held_out() -> None:
    assert np.flatnonzero(held_out(small_log((28,)))).tolist() == [21, 22, 23, 24, 25, 26, 27]


def test_a_stretch_counts_after_its_first_moments_and_where_it_is_wanted() -> None:
    wanted = np.ones(10, dtype=bool)
    wanted[8] = False
    windows = stretches(small_log((10,)), wanted)  # 0.3 s are 6 steps: rows 1..6 do not count
    assert windows.first.tolist() == [0] and windows.length == 9
    assert windows.rows[windows.counted].tolist() == [7, 9]


def test_long_episodes_are_cut_into_stretches_that_overlap_by_their_first_moments() -> None:
    log = small_log((151, 5))
    windows = stretches(log, np.ones(156, dtype=bool))  # 5 s are 100 steps
    assert windows.first.tolist() == [0, 94] and PERIOD == 0.05, "an episode of less than those moments tells nothing"
    assert windows.rows[windows.counted].tolist() == list(range(7, 151)), "every row counts once"


def test_fewer_windows_are_spread_evenly() -> None:
    windows = short_windows(small_log((41,)), 4, ALL)
    assert windows.thinned(12).first.tolist() == [0, 16, 36] and windows.thinned(1000) is windows
