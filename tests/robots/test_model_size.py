"""What a model asks for is counted before MuJoCo makes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import UsageError
from skillcli.robots.model_size import MAX_BYTES, check_size


def model(folder: Path, body: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(f"<mujoco>{body}</mujoco>", encoding="utf-8")
    return path


def nested(outer: int, inner: int) -> str:
    return f'<replicate count="{outer}"><replicate count="{inner}"><geom size="1"/></replicate></replicate>'


FINE = {
    "copies of copies, 100 times 100": nested(100, 100),
    "copies beside each other": '<replicate count="10000"/>' * 3,
    "2000 times 2000 samples": '<hfield nrow="2000" ncol="2000"/>',
    "a count that MuJoCo refuses": '<replicate count="many"/>',
}
TOO_MUCH = {
    "<replicate> in robot.xml makes 1.01e+04": nested(101, 100),
    "<hfield> in robot.xml makes 4e+06": '<hfield nrow="2000" ncol="2001"/>',
    "<flexcomp> in robot.xml makes 2.7e+04": '<flexcomp count="30 30 30"/>',
    "<composite> in robot.xml makes 2e+04": '<replicate count="200"><composite count="-100"/></replicate>',
}


@pytest.mark.parametrize("body", FINE.values(), ids=FINE)
def test_what_can_be_made_is_left_to_mujoco(tmp_path: Path, body: str) -> None:
    check_size(model(tmp_path, body))


@pytest.mark.parametrize(("said", "body"), TOO_MUCH.items())
def test_what_makes_too_much_is_refused_with_the_number(tmp_path: Path, said: str, body: str) -> None:
    with pytest.raises(UsageError) as caught:
        check_size(model(tmp_path, body))
    assert said in caught.value.message and caught.value.hint.startswith("at most ")


def test_files_that_are_included_count_and_a_ring_of_them_ends(tmp_path: Path) -> None:
    path = model(tmp_path, '<include file="part.xml"/>')
    model(tmp_path, '<include file="robot.xml"/>', "part.xml")
    check_size(path)
    model(tmp_path, nested(101, 100), "part.xml")
    with pytest.raises(UsageError, match=r"in part\.xml"):
        check_size(path)


def test_a_huge_file_is_refused_unread_and_what_is_no_xml_or_not_there_is_left_to_mujoco(tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    check_size(path)
    path.write_text("<mujoco>", encoding="utf-8")
    check_size(path)
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(UsageError, match=r"robot\.xml has 32 MiB"):
        check_size(path)
