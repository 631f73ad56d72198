"""How the viewer is started; it is never really opened here."""

import subprocess
from pathlib import Path

import pytest

from skillcli.errors import SkillError
from skillcli.viz import viewer


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands that would have been run."""
    commands: list[list[str]] = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, **_: commands.append(command))
    monkeypatch.setattr(viewer.shutil, "which", lambda name, path=None: f"/bin/{name}")
    return commands


def test_both_ways_listen_on_this_machine_only(started: list[list[str]], tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    path.touch()
    viewer.open_viewer(path)
    viewer.serve_web(path)
    assert started == [
        ["/bin/rerun", str(path), "--bind", "127.0.0.1"],
        ["/bin/rerun", str(path), "--serve-web", "--bind", "127.0.0.1"],
    ]


def test_a_missing_recording_is_said(tmp_path: Path) -> None:
    with pytest.raises(SkillError, match="no recording"):
        viewer.open_viewer(tmp_path / "a.rrd")


def test_a_missing_viewer_is_said_with_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.rrd").touch()
    monkeypatch.setattr(viewer.shutil, "which", lambda name, path=None: None)
    with pytest.raises(SkillError, match="viewer was not found") as caught:
        viewer.serve_web(tmp_path / "a.rrd")
    assert "rerun-sdk" in caught.value.hint
