"""Which joints of a model are its arm: the hinges from the base to the hand, without trunk and fingers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import mujoco

from skillcli.errors import UsageError
from skillcli.robots.config import FEWEST, MOST
from skillcli.robots.mjcf import upwards

OF_A_HAND = re.compile(r"grip|finger|thumb|jaw|claw|knuckle|palm|tooth|driver|spring_link|follower|coupler", re.IGNORECASE)
OF_A_WRIST = re.compile(r"wrist|roll|rotat", re.IGNORECASE)
_HINGE = mujoco.mjtJoint.mjJNT_HINGE


@dataclass(frozen=True)
class Chain:
    """The arm of a model.

    Attributes:
        joints: its hinges, from the base to the hand.
        others: arms that the model has beside it, each as its first and its last joint.
    """

    joints: tuple[str, ...]
    others: tuple[tuple[str, str], ...]


def find_chain(spec: mujoco.MjSpec) -> Chain:
    """The longest chain of 4 to 8 hinges, the first in the file where several are as long.

    Raises:
        UsageError: there is none, or its joints have no names.
    """
    ways = {way for body in spec.bodies[1:] if (way := _way(body))}
    leaves = [way for way in ways if not any(other != way and other[: len(way)] == way for other in ways)]
    arms = sorted({_without_trunk(way, leaves) for way in leaves}, key=lambda arm: (-len(arm), _order(spec, arm)))
    fitting = [arm for arm in arms if FEWEST <= len(arm) <= MOST]
    if not fitting:
        chains = ", ".join(f"{len(arm)} ({_shown(arm)})" for arm in arms[:4])
        raise UsageError(
            f"model: expected one arm of {FEWEST} to {MOST} hinges, found {f'chains of {chains}' if chains else 'no hinge'}",
            "cut the model down to one arm, or write the robot file by hand (docs/robots.md)",
        )
    names = tuple(joint.name for joint in _joints(spec, fitting[0]))
    if not all(names):
        raise UsageError("model: a joint of the arm has no name", "give every joint of the arm a name in the model")
    others = [_joints(spec, arm) for arm in fitting[1:]]
    return Chain(names, tuple((each[0].name, each[-1].name) for each in others))


def _way(body: Any) -> tuple[str, ...]:
    """Bodies with hinges of an arm from the base to a body, by name; an end at the hand."""
    found = []
    for part in reversed(list(upwards(body))[:-1]):
        hinges = [joint for joint in part.joints if joint.type == _HINGE]
        if len(hinges) < len(part.joints):
            continue  # it also slides: a mobile base
        if any(_of_a_hand(joint, part) for joint in hinges):
            break
        found += [part.name] * len(hinges)
    return tuple(found)


def _of_a_hand(joint: Any, body: Any) -> bool:
    """Whether a hinge moves a finger: the wrist of many arms turns a body that is called gripper."""
    moving = [part for part in body.find_all("body") if part.joints]
    fingers = [part for part in moving if not any(above.name in {each.name for each in moving} for above in _above(part))]
    if len(fingers) > 1:
        return False  # what carries several fingers is the wrist
    return bool(OF_A_HAND.search(joint.name) or (OF_A_HAND.search(body.name) and not OF_A_WRIST.search(joint.name)))


def _above(body: Any) -> list[Any]:
    return list(upwards(body))[1:]


def _without_trunk(way: tuple[str, ...], ways: list[tuple[str, ...]]) -> tuple[str, ...]:
    """The part behind the last place where another arm branches off."""
    shared = 0
    for other in ways:
        common = next((i for i, (a, b) in enumerate(zip(way, other, strict=False)) if a != b), min(len(way), len(other)))
        if other != way and len(other) - common >= FEWEST and len(way) - common >= FEWEST:
            shared = max(shared, common)
    return way[shared:]


def _joints(spec: mujoco.MjSpec, arm: tuple[str, ...]) -> list[Any]:
    return [joint for name in dict.fromkeys(arm) for joint in spec.body(name).joints if joint.type == _HINGE]


def _order(spec: mujoco.MjSpec, arm: tuple[str, ...]) -> int:
    return next((i for i, body in enumerate(spec.bodies) if arm and body.name == arm[0]), 0)


def _shown(arm: tuple[str, ...]) -> str:
    return f"{arm[0]} .. {arm[-1]}" if arm else "no hinge"
