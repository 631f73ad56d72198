"""What a ring keeps, and that its columns stay together."""

from __future__ import annotations

import numpy as np

from skillcli.learning.ring_buffer import RingBuffer


def test_the_oldest_is_forgotten_first_and_rows_stay_together() -> None:
    ring = RingBuffer(4, np.float32)
    for number in range(6):
        column = np.full((1, 2), float(number))
        ring.add(column, column[:, 0], column > 3)
    assert (ring.filled, ring.next) == (4, 2) and all(column.dtype == np.float32 for column in ring.columns)
    place, number, large = ring.sample(100, np.random.default_rng(0))
    assert set(number.tolist()) == {2, 3, 4, 5}
    np.testing.assert_array_equal(place, np.stack([number, number], axis=1))
    np.testing.assert_array_equal(large[:, 0], number > 3)


def test_more_rows_at_once_than_it_holds_wrap_around() -> None:
    ring = RingBuffer(3)
    ring.add(np.arange(2.0))
    ring.add(np.arange(2.0, 4.0))
    assert sorted(ring.columns[0].tolist()) == [1, 2, 3] and ring.next == 1
