"""Servos of foreign arms in one form, worked out by hand: torque = kp (target - angle) - kv speed."""

from __future__ import annotations

import mujoco
import pytest

from skillcli.errors import UsageError
from skillcli.robots.config import Gains
from skillcli.robots.servos import FREE, Servo, find_servos

# At the actuator 10 u - 10 length - 3 rate; behind a gear g the joint sees g times that, and length = g angle.
SERVO = '<general name="u" joint="a" gear="{gear}" gainprm="10" biastype="affine" biasprm="0 -10 -3" {limits}/>'
MOTOR = '<motor name="m" joint="a" gear="2" ctrlrange="-3 3" ctrllimited="true"/>'
LIMITS = 'ctrllimited="true" ctrlrange="-1 2" forcelimited="true" forcerange="-5 7"'
GAINS = Gains(kp=(900.0,) * 7, kv=(90.0,) * 7)


def found(actuators: str, named: list[str] | None = None, gains: Gains | None = None) -> tuple[list[Servo], list[int]]:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="a"/><geom size="0.1"/><body><joint name="b"/><geom size="0.1"/></body></body>'
        f"</worldbody><actuator>{actuators}</actuator></mujoco>"
    )
    return find_servos(model, ["a"], named, gains)


def test_a_gear_acts_twice_on_gains_and_once_on_targets_and_torques() -> None:
    # 2 (10 u - 10 · 2 q - 3 · 2 v) = 40 (u / 2 - q) - 12 v
    assert found(SERVO.format(gear=2, limits=LIMITS)) == ([Servo("a", 40.0, 12.0, (-10.0, 14.0), (-0.5, 1.0))], [0])


def test_a_gear_that_turns_the_other_way_swaps_the_limits() -> None:
    assert found(SERVO.format(gear=-2, limits=LIMITS))[0] == [Servo("a", 40.0, 12.0, (-14.0, 10.0), (-1.0, 0.5))]


def test_a_servo_without_limits_is_free() -> None:
    assert found(SERVO.format(gear=1, limits=""))[0] == [Servo("a", 10.0, 3.0, FREE, FREE)]


def test_gains_replace_a_motor_and_keep_its_torque() -> None:
    assert found(MOTOR, gains=GAINS) == ([Servo("a", 900.0, 90.0, (-6.0, 6.0))], [0])
    stronger = GAINS.model_copy(update={"force": (8.0,) * 7})
    assert found(MOTOR, gains=stronger)[0] == [Servo("a", 900.0, 90.0, (-8.0, 8.0))]


def test_a_motor_beside_the_servo_stays() -> None:
    assert found(SERVO.format(gear=1, limits="") + MOTOR)[1] == [0]


def test_the_other_position_servo_of_a_joint_goes_too() -> None:
    both = SERVO.format(gear=1, limits="") + '<position name="w" joint="a" kp="7"/>'
    servos, replaced = found(both, named=["w"])
    assert [servo.kp for servo in servos] == [7.0] and replaced == [1, 0]


@pytest.mark.parametrize(
    ("actuators", "named", "said", "hint"),
    [
        ("", None, "joint 'a' has no actuator", "give [gains]"),
        (MOTOR, None, "joint 'a' has no position servo", "give [gains]"),
        (SERVO.format(gear=1, limits="") + '<position name="w" joint="a"/>', None, "2 position servos: 'u', 'w'", "say which"),
        (MOTOR, ["x"], "no actuator 'x' in the model", "actuators: m"),
        (MOTOR + '<position name="w" joint="b"/>', ["w"], "'w' does not drive joint 'a'", "on 'a': 'm'"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_to_do(actuators: str, named: list[str] | None, said: str, hint: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        found(actuators, named)
    assert hint in caught.value.hint
