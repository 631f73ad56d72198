"""Room for boxes on the table, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.errors import UsageError
from skillcli.robots.scene import TABLE_CENTRE, TABLE_HALF_SIZE
from skillcli.tasks.on_table import check_start_on_table, room_on_table


def test_the_room_on_the_table_ends_a_margin_before_its_rim() -> None:
    lowest, highest = room_on_table(0.04)
    np.testing.assert_allclose((lowest + highest) / 2, TABLE_CENTRE)
    np.testing.assert_allclose(highest - lowest, 2 * np.array(TABLE_HALF_SIZE[:2]) - 0.08)


def test_a_start_that_is_drawn_over_the_rim_is_refused() -> None:
    place = room_on_table(0.04)[1] - 0.05
    check_start_on_table("a box at task.box_start", tuple(place), 0.04, -0.05, 0.05)
    with pytest.raises(UsageError, match=r"a box at task.box_start \(.*\), drawn -0.05 to 0.06 m off, starts off the table"):
        check_start_on_table("a box at task.box_start", tuple(place), 0.04, -0.05, 0.06)
