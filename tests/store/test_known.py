"""The list of what was written here: one hash a line, bounded, and never a reason to fail."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.store import known


@pytest.fixture
def listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the list of a fresh account lies."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    forget(monkeypatch)
    return tmp_path / "skill" / "written-here"


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a new process begins: nothing is in memory."""
    found: set[str] = set()
    monkeypatch.setattr(known, "_digests", lambda: found)
    if known._path().is_file():
        found.update(known._path().read_text().split())


def test_what_is_remembered_is_known_in_the_next_process(listed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not known.is_known("a" * 64)
    known.remember("a" * 64)
    known.remember("a" * 64)
    known.remember("b" * 64)
    assert listed.read_text() == "a" * 64 + "\n" + "b" * 64 + "\n"
    forget(monkeypatch)
    assert known.is_known("a" * 64) and known.is_known("b" * 64) and not known.is_known("c" * 64)


def test_a_list_that_is_too_long_forgets_its_older_half(listed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(known, "_LONGEST", 8)
    for digest in ("aa", "bb"):  # three bytes each
        known.remember(digest)
    assert listed.read_text() == "aa\nbb\n"
    known.remember("cc")
    assert listed.read_text() == "bb\ncc\n"


def test_a_list_that_cannot_be_written_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skill").touch()  # where its folder should be
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    forget(monkeypatch)
    known.remember("a" * 64)
    assert known.is_known("a" * 64) and (tmp_path / "skill").read_bytes() == b""


def test_a_cache_folder_that_is_not_absolute_is_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert known._path() == tmp_path / ".cache" / "skill" / "written-here"
