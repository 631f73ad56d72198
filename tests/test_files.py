"""Files that appear whole or not at all, several together."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import SkillError
from skillcli.files import replacing


def test_files_get_their_names_together_when_all_is_done(tmp_path: Path) -> None:
    one, two = tmp_path / "a.png", tmp_path / "b.rrd"
    two.write_text("before")
    with replacing(one, two) as (first, second):
        first.write_text("1")
        second.write_text("2")
        assert not one.exists() and two.read_text() == "before"
        assert first.suffix == ".png" and first.parent == tmp_path and first.name.startswith(".tmp-a-")
    assert (one.read_text(), two.read_text()) == ("1", "2") and sorted(tmp_path.iterdir()) == [one, two]


def test_work_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_text("before")
    with pytest.raises(ZeroDivisionError), replacing(path) as (temporary,):
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]


def test_a_disk_that_is_full_is_said_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    with pytest.raises(SkillError) as caught, replacing(path):
        raise OSError(28, "No space left on device")
    assert caught.value.message == f"cannot write {path}: No space left on device" and "space" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["there", "missing/a.png"])
def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path, name: str) -> None:
    (tmp_path / "there").mkdir()
    worked = []
    with pytest.raises(SkillError, match="cannot write"), replacing(tmp_path / "fine.png", tmp_path / name):
        worked.append(name)
    assert not worked and list(tmp_path.iterdir()) == [tmp_path / "there"]
