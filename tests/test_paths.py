"""Paths from elsewhere: what is not a plain small file is refused at once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from skillcli.paths import LONGEST_PATH, expanded, read_small


def test_a_small_file_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    assert read_small(path, 3) == b"abc"
    with pytest.raises(ValueError, match="larger than 0 kB"):
        read_small(path, 2)


def test_pipes_devices_folders_and_what_is_no_path_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(ValueError, match="it is not a file"):
            read_small(path, 100)
    for text in ("a\0b", "\ud800", str(tmp_path), str(tmp_path / "none"), "a" * (LONGEST_PATH + 1)):
        with pytest.raises((OSError, ValueError)):
            read_small(Path(text), 100)


def test_a_home_folder_that_is_not_known_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/me")
    assert expanded("~/robot.toml") == Path("/home/me/robot.toml")
    assert expanded("~nobody-of-that-name/robot.toml") == Path("~nobody-of-that-name/robot.toml")
