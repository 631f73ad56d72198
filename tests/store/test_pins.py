"""Pins: an empty file beside what it protects, which is not touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.store.pins import is_pinned, pin, unpin


@pytest.fixture
def artifact(tmp_path: Path) -> Path:
    path = tmp_path / "run" / "pretrain-v1.h5"
    path.parent.mkdir()
    path.write_bytes(b"whatever")
    return path


def test_a_pin_is_an_empty_file_in_a_folder_beside_it(artifact: Path) -> None:
    assert not is_pinned(artifact)
    pin(artifact)
    mark = artifact.parent / ".pins" / "pretrain-v1"
    assert is_pinned(artifact) and mark.read_bytes() == b"" and artifact.read_bytes() == b"whatever"


def test_a_pin_protects_one_version_only(artifact: Path) -> None:
    pin(artifact)
    assert not is_pinned(artifact.with_name("pretrain-v2.h5")) and not is_pinned(artifact.with_name("pretrain-v11.h5"))


def test_pinning_and_unpinning_twice_is_as_once(artifact: Path) -> None:
    pin(artifact)
    pin(artifact)
    unpin(artifact)
    assert not is_pinned(artifact)
    unpin(artifact)
    assert not is_pinned(artifact) and artifact.exists()


def test_a_pin_may_stand_before_the_file_does(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    pin(tmp_path / "run" / "compose-v3.h5")
    assert is_pinned(tmp_path / "run" / "compose-v3.h5")
