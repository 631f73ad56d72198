"""Texts about a played episode: a title beside the gripper, a label in the time series, and a card."""

from __future__ import annotations

import textwrap

import numpy as np
import rerun as rr

from skillcli.config.randomization import PARAMETERS
from skillcli.metrics import final_distance
from skillcli.plaintext import markdown
from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.recording.clock import Clock
from skillcli.viz.scene import Scene

LABEL_WIDTH = 46  # characters


def title(scene: Scene, episode: int) -> str:
    """Name the episode and its end, short enough to stand beside the gripper."""
    return f"{scene.episode_labels[episode]}: {_ending(scene, episode)}"


def label(scene: Scene, episode: int) -> str:
    """Return the title, and below it the parameters that differ from other episodes of the domain."""
    parameters = [_short(name, values[episode]) for name, values in scene.parameters.items() if _tells(scene, values, episode)]
    return "\n".join([title(scene, episode), *textwrap.wrap(", ".join(parameters), LABEL_WIDTH)])


def log_card(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log everything about the playing episode, from its first step on."""
    document = rr.TextDocument.columns(text=[card(scene, clock.episode)], media_type=[rr.MediaType.MARKDOWN])
    stream.send_columns("episode", clock.columns(slice(0, 1)), document)


def card(scene: Scene, episode: int) -> str:
    """Describe the episode's end, its distances to the waypoints, and the parameters of its robot, as Markdown."""
    won = "success" if scene.trajectories.success[episode] else "failure"
    parts = [f"## {markdown(scene.episode_labels[episode])}", f"**{won}**, {_ending(scene, episode)}"]
    if (sent := motion.sent(scene)) is not None:
        parts[-1] += f" (in the source: {_ending(sent, int(scene.episode_source[episode]))})"
    if len(passes := motion.closest(scene, episode)):
        parts.append("closest to its waypoints, in order: " + ", ".join(f"{100 * gap:.1f} cm" for gap in passes))
    rows = [
        f"| {markdown(name.replace('_', ' '))} | {_numbers(values[episode])} | {PARAMETERS[name][1]} |"
        for name, values in scene.parameters.items()
        if not np.isnan(values[episode]).any()
    ]
    return "\n\n".join([*parts, *(["\n".join(["| drawn | value | unit |", "|---|---|---|", *rows])] if rows else [])])


def _numbers(values: Array) -> str:
    return " ".join(f"{x:.3g}" for x in np.atleast_1d(values))


def _ending(scene: Scene, episode: int) -> str:
    if not scene.trajectories.stable[episode]:
        return "unstable: the simulation diverged"
    return f"ends {100 * final_distance(scene.trajectories)[episode]:.1f} cm off"


def _tells(scene: Scene, values: Array, episode: int) -> bool:
    """Return whether a parameter is a single number that differs between episodes of the domain."""
    if values.ndim > 1 or np.isnan(values[episode]):
        return False
    others = motion.domains(scene)[motion.domain(scene.episode_labels[episode])]
    return bool(np.ptp(values[others]) > 0)


def _short(name: str, value: float) -> str:
    unit = PARAMETERS[name][1]
    shown = {"s": f"{1000 * value:.0f} ms", "m": f"{1000 * value:.1f} mm", "factor": f"×{value:.2f}"}
    return f"{name.replace('_', ' ')} {shown.get(unit, f'{value:.3g} {unit}')}"
