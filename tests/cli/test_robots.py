"""`skill robots`."""

from __future__ import annotations

from pathlib import Path

import pytest
from command import TINY_SET, skill

TORQUE = Path(__file__).parent.parent / "robots" / "torque.toml"


def test_the_list_has_every_robot_that_comes_along() -> None:
    listed = skill("--json", "robots").json["robots"]
    assert {"sawyer", "ur5e"} <= {each["name"] for each in listed}
    assert all(len(each["joints"]) >= 5 and each["description"] for each in listed)
    assert "Universal Robots UR5e" in skill("robots").out


def test_a_robot_is_shown_with_its_limits_and_drawn(tmp_path: Path) -> None:
    picture = tmp_path / "arm.png"
    shown = skill("--json", "robots", "show", "ur5e", "--png", str(picture)).json
    assert shown["name"] == "ur5e" and len(shown["joints"]) == len(shown["home"]) == len(shown["servos"]) == 6
    first = shown["joints"][0]
    assert first["name"] == "shoulder_pan_joint" and first["low"] == -first["high"] and first["speed"] == 3.14
    assert picture.read_bytes().startswith(b"\x89PNG") and shown["png"] == str(picture)


def test_a_robot_file_is_shown_with_what_it_does_not_say(tmp_path: Path) -> None:
    shown = skill("--json", "robots", "show", str(TORQUE)).json
    assert shown["name"] == "torque" and shown["joints"][0]["speed"] is None and shown["finger"] == "ours"
    assert shown["joints"][0]["acceleration"] is None, "it does not say"
    assert skill("robots", "show", str(TORQUE)).out.count("base_yaw") == 1


def test_what_is_no_robot_is_refused(tmp_path: Path) -> None:
    missing = skill("--json", "robots", "show", "nobody")
    assert missing.code == 2 and "sawyer" in missing.json["error"]["hint"]
    assert skill("robots", "show", "ur5e", "--png", str(tmp_path / "arm.txt")).code == 2


@pytest.mark.slow
def test_a_recipe_trains_on_another_arm(tmp_path: Path) -> None:
    trained = skill("--store", str(tmp_path), "--json", "pretrain", "smoke", "--robot", "ur5e", *TINY_SET)
    robot = trained.json["robot"]
    assert robot["name"] == "ur5e" and len(robot["joints"]) == 6 and len(robot["fingerprint"]) == 64
    assert trained.json["observation"][0]["size"] == 6
