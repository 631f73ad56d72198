"""One process at a time for one cell."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from skillcli.errors import StoreError
from skillcli.sweeps.alone import alone


def test_only_one_is_inside_at_a_time_and_nothing_is_left(tmp_path: Path) -> None:
    inside, most, turns = 0, 0, 0

    def run() -> None:
        nonlocal inside, most, turns
        for _ in range(20):
            with alone(tmp_path / "cell"):
                inside, turns = inside + 1, turns + 1
                most = max(most, inside)
                time.sleep(0.001)
                inside -= 1

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (most, turns) == (1, 80) and not list((tmp_path / "cell").iterdir())


def test_an_error_inside_ends_the_lock(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="inside"), alone(tmp_path):
        raise ValueError("inside")
    with alone(tmp_path):
        assert len(list(tmp_path.iterdir())) == 1


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "cell").write_text("a file")
    with pytest.raises(StoreError, match="cannot write in"), alone(tmp_path / "cell"):
        pass
