"""A domain file as text, with what was identified."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from skillcli.config.randomization import PARAMETERS
from skillcli.execution.identify.result import Estimate, Identified
from skillcli.plaintext import line
from skillcli.simulation.domains import PRESETS

DIGITS = 5  # significant ones
FITTED = "fitted"


def domain_name(path: Path) -> str:
    """Return the name of a domain that is written to a path: that of the file as far as a name may be so."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", path.stem).strip("-_.")[:40]
    return f"{FITTED}-{name}"[:40] if name in PRESETS else name or FITTED


def domain_text(name: str, found: Identified, log: str, robot: str) -> str:
    """Return the file: a value that is known to differ from its interval's ends as a range, one for each joint.

    Args:
        name: of the domain.
        found: what was identified.
        log: where from, for the comment.
        robot: as it was named, for the comment.
    """
    errors = found.half_second, found.one_step
    lines = [
        f"# Written by `skill identify` from {_plain(log)} on the robot {_plain(robot)}.",
        f"# Commands: {found.meaning}. Held out: {found.heldout}, {found.heldout_steps} control steps.",
        *(
            f"# Error over {what}, root mean square: {each.fitted:.5f} rad; nominal simulation {each.nominal:.5f}, "
            f"an arm that stays {each.unmoved:.5f}."
            for what, each in zip(("half a second", "one step"), errors, strict=True)
        ),
        *(f"# {_plain(note)}." for note in found.notes),
    ]
    tool = found.parameters.get("tool_offset")
    if tool is not None:
        place = ", ".join(f"{part:.4f}" for part in tool.value)
        lines.append(f"# The measured gripper is at ({place}) m from that of the robot file, in the axes of its gripper.")
    lines += [
        f"name = {json.dumps(name)}",
        f"description = {json.dumps(f'identified from a log of {_plain(robot)}', ensure_ascii=False)}",
        "",
        "[parameters]",
    ]
    for parameter, estimate in found.parameters.items():
        if parameter in PARAMETERS:
            remark = "" if estimate.told else "   # the log does not tell: as wide as believed before"
            lines.append(f"{parameter} = {_range(parameter, estimate)}{remark}")
    return "\n".join(lines) + "\n"


def _range(parameter: str, estimate: Estimate) -> str:
    bounds = PARAMETERS[parameter]
    low, high = (np.clip(end, bounds.low, bounds.high) for end in (estimate.low, estimate.high))
    if parameter == "latency" or (low == high).all():
        return _numbers(estimate.value)
    if estimate.value.ndim:
        return f"{{ low = {_numbers(low)}, high = {_numbers(high)} }}"
    return f"{{ uniform = [{_numbers(low)}, {_numbers(high)}] }}"


def _numbers(values: Any) -> str:
    """Return a number or a list as TOML."""
    if np.ndim(values):
        return f"[{', '.join(_numbers(each) for each in values)}]"
    return repr(float(f"{float(values):.{DIGITS}g}"))


def _plain(text: str) -> str:
    """Return one line of a comment, whatever a path or a log says."""
    return line(text)[:200]
