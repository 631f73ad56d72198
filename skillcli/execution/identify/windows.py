"""Cut a log into windows that a simulation replays, and keep some parts of it out of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillcli.execution.log import Log
from skillcli.trajectories import Array

HALF_SECOND = 0.5  # s, of a window that is predicted
STRETCH = 5.0  # s, of a window in which servos keep a simulation near the log
RUN_IN = 0.3  # s at the start of a stretch that do not count: three time constants of a servo, which forgets where it began
ENOUGH_EPISODES = 4  # from here on whole episodes are kept out, else parts of them


@dataclass(frozen=True)
class Windows:
    """W windows of L control steps: a simulation begins at row `first` and predicts the L rows behind it.

    Attributes:
        first: (W,) rows of the log.
        length: L.
        counted: (W, L) bool, which predictions count.
    """

    first: Array
    length: int
    counted: Array

    @property
    def rows(self) -> Array:
        """Return the rows that are predicted, (W, L)."""
        rows: Array = self.first[:, None] + 1 + np.arange(self.length)
        return rows

    def thinned(self, steps: int) -> Windows:
        """Return at most so many control steps, from windows spread evenly over these."""
        count = max(1, steps // self.length)
        if count >= len(self.first):
            return self
        kept = np.linspace(0, len(self.first) - 1, count).round().astype(int)
        return Windows(self.first[kept], self.length, self.counted[kept])


def in_steps(seconds: float, period: float) -> int:
    """Return a time in control steps, at least one."""
    return max(1, round(seconds / period))


def held_out(log: Log) -> Array:
    """Return which rows are kept out of the fit, (T,) bool.

    Of four and more episodes every third; else every fourth half second of each.
    """
    held = np.zeros(len(log.stamps), dtype=bool)
    block = in_steps(HALF_SECOND, log.period)
    for number, rows in enumerate(log.episodes):
        if len(log.starts) >= ENOUGH_EPISODES:
            held[rows] = number % 3 == 2
        else:
            step = np.arange(rows.stop - rows.start) - 1  # the first row is where the first window begins
            held[rows] = (step >= 0) & (step // block % 4 == 3)
    if not held.any():  # shorter than two seconds
        last = log.episodes[-1]
        held[(last.start + 3 * last.stop) // 4 : last.stop] = True
    return held


def how_held_out(log: Log) -> str:
    """Return in words what `held_out` chose."""
    return "every third episode" if len(log.starts) >= ENOUGH_EPISODES else "every fourth half second"


def short_windows(log: Log, length: int, wanted: Array, run_in: int = 0) -> Windows:
    """Return windows of a length, one behind the other in each episode, all of whose predictions are `wanted`, (T,) bool.

    With a run-in each begins so many control steps earlier, which do not count, and need not be wanted.
    """
    first = [
        row for rows in log.episodes for row in range(rows.start, rows.stop - length, length) if row - run_in >= rows.start
    ]
    kept = np.array([row for row in first if wanted[row + 1 : row + 1 + length].all()], dtype=int)
    counted = np.repeat(np.arange(run_in + length)[None] >= run_in, len(kept), axis=0)
    return Windows(kept - run_in, run_in + length, counted)


def stretches(log: Log, wanted: Array) -> Windows:
    """Return long windows over all of the log; the first moments of each, and what is not `wanted`, do not count."""
    run_in, length = in_steps(RUN_IN, log.period), in_steps(STRETCH, log.period)
    length = min(length, max(rows.stop - rows.start for rows in log.episodes) - 1)
    first, counted = [], []
    for rows in log.episodes:
        begin, last = rows.start, rows.stop - 1
        while begin + run_in < last:
            predicted = begin + 1 + np.arange(length)
            count = (np.arange(length) >= run_in) & (predicted <= last) & wanted[np.minimum(predicted, last)]
            if count.any():
                first.append(begin)
                counted.append(count)
            begin += length - run_in
    return Windows(np.array(first, dtype=int), length, np.array(counted, dtype=bool).reshape(len(first), length))
