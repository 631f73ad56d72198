"""A hand in a robot file: what is found in the model, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import UsageError
from skillcli.robots.config import bundled_file
from skillcli.robots.robot import load_robot


def panda_with(folder: Path, **changes: str) -> Path:
    """Write the Panda's file with other lines in [hand]."""
    text = bundled_file("panda").read_text()
    model = bundled_file("panda").with_name("panda.xml")
    lines = [line for line in text.splitlines() if line.split(" = ")[0] not in changes]
    added = [f"{key} = {said}" for key, said in changes.items()]
    file = folder / "hand.toml"
    file.write_text("\n".join([*lines, *added]).replace('"panda.xml"', f'"{model}"'))
    return file


def test_the_panda_has_two_fingers() -> None:
    hand = load_robot("panda").graspers()
    assert (hand.widest, hand.force, hand.speed) == (0.08, 70, 0.1)
    assert hand.joints == hand.servos == ("robot/finger_joint1", "robot/finger_joint2")


def test_an_arm_without_a_hand_says_which_arms_have_one() -> None:
    with pytest.raises(UsageError, match="robot ur5e has no hand that can grasp") as caught:
        load_robot("ur5e").graspers()
    assert "panda" in str(caught.value.hint)


@pytest.mark.parametrize(
    ("key", "said", "complaint"),
    [
        ("joints", '["finger_joint1", "thumb"]', "no joint 'thumb'"),
        ("joints", '["finger_joint1", "joint3"]', "'joint3' does not slide"),
        ("widest", "0.2", "'finger_joint1' slides by 0.04 m"),
        ("actuators", '["finger_joint1", "joint1"]', "'finger_joint2' needs one position servo"),
    ],
)
def test_a_hand_that_does_not_fit_is_refused_with_one_line(tmp_path: Path, key: str, said: str, complaint: str) -> None:
    if key == "joints":  # also the name of a key of the arm
        text = bundled_file("panda").read_text().replace('["finger_joint1", "finger_joint2"]', said)
        file = tmp_path / "hand.toml"
        file.write_text(text.replace('"panda.xml"', f'"{bundled_file("panda").with_name("panda.xml")}"'))
    else:
        file = panda_with(tmp_path, **{key: said})
    with pytest.raises(UsageError, match=complaint):
        load_robot(file)


def test_a_hand_changes_nothing_for_tasks_that_do_not_grasp(tmp_path: Path) -> None:
    file = panda_with(tmp_path, force="30")
    assert load_robot(file).hand != load_robot("panda").hand
    assert load_robot(file).fingerprint == load_robot("panda").fingerprint
