"""Models out of a checkout of MuJoCo Menagerie."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import UsageError
from skillcli.robots.mjcf import find_model


def test_without_a_checkout_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    with pytest.raises(UsageError, match="MENAGERIE_ROOT is not set"):
        find_model(tmp_path, "menagerie:acme_arm")
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path / "nowhere"))
    with pytest.raises(UsageError, match="is no folder"):
        find_model(tmp_path, "menagerie:acme_arm")


def test_a_model_is_found_by_its_folder_or_its_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = tmp_path / "acme_arm"
    folder.mkdir()
    for name in ("arm.xml", "arm_hand.xml", "scene.xml", "scene_arm.xml"):
        (folder / name).write_text("<mujoco/>", encoding="utf-8")
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    assert find_model(Path("elsewhere"), "menagerie:acme_arm") == folder / "arm.xml"
    assert find_model(Path("elsewhere"), "menagerie:acme_arm/arm_hand") == folder / "arm_hand.xml"
    with pytest.raises(UsageError, match="no model 'other'") as caught:
        find_model(Path("elsewhere"), "menagerie:other")
    assert "acme_arm" in caught.value.hint


def test_other_names_are_paths_beside_the_robot_file(tmp_path: Path) -> None:
    assert find_model(tmp_path, "arm.xml") == tmp_path / "arm.xml"
