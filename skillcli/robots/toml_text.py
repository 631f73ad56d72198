"""A robot file as text, with comments for whoever reads it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RobotText:
    """A robot file in the making.

    Attributes:
        model: as the file names it.
        joints: of the arm.
    """

    model: str
    joints: tuple[str, ...]

    def written(
        self, keys: Mapping[str, Any], speeds: tuple[float, ...] | None, guessed: Sequence[str], unknown: Sequence[str]
    ) -> str:
        """The file: what is known as keys, what was guessed and what is unknown as comments."""
        lines = ["# Written by `skill robots new`. Guessed, so worth a look:"]
        lines += [f"#   {_plain(item)}" for item in guessed]
        lines += ["# What only a person can know:", *(f"#   {_plain(item)}" for item in unknown)]
        lines += [
            "",
            'description = ""',
            f"model = {_value(self.model)}",
            f"joints = {_value(self.joints)}   # from the base to the hand",
        ]
        if keys.get("finger") is not None:
            lines.append(f"finger = {_value(keys['finger'])}   # bodies that push; without this line our finger is mounted")
        if "actuators" in keys:
            lines.append(f"actuators = {_value(keys['actuators'])}   # of several, the one that drives each joint")
        if "start" in keys:
            lines.append(f"start = {_value(keys['start'])}   # rad, at reset: the gripper points down as far as the arm can")
        if speeds is None:
            lines.append(
                f"# speed_limit = {_value([3.0] * len(self.joints))}   # rad/s, of the data sheet: fill in, take the # away"
            )
        else:
            lines.append(f"speed_limit = {_value(speeds)}   # rad/s")
        lines += ["", "[gripper]   # z points out of the hand"]
        lines += [f"{key} = {_value(keys['gripper'][key])}" for key in ("body", "pos", "quat")]
        if "base" in keys:
            lines += [
                "",
                "[base]   # the table top is at z = 0, the arm looks along x",
                f"pos = {_value(keys['base']['pos'])}   # m",
                *([f"quat = {_value(keys['base']['quat'])}"] if "quat" in keys["base"] else []),
            ]
        if "gains" in keys:
            lines += ["", "[gains]   # position control of ours: N·m/rad, N·m·s/rad, N·m"]
            lines += [f"{key} = {_value(numbers)}" for key, numbers in keys["gains"].items()]
        return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """One line of a comment, whatever names a model has."""
    return " ".join(str(text).split())


def _value(item: Any) -> str:
    """A value as TOML: strings, numbers and lists of them are written as JSON writes them."""
    return json.dumps(item, ensure_ascii=False)
