"""The panel: skills, latents, goal and plan, robot and its parameters, recording, and how things stand."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser

from skillcli.errors import SkillError, UsageError
from skillcli.plaintext import line
from skillcli.robots.config import bundled_robots, describe_robot
from skillcli.robots.robot import load_target
from skillcli.viz.play.loop import Rate
from skillcli.viz.play.planning import methods
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.state import Status

SLIDER_STEPS = 200
SHORT, MANY = 6, 4  # letters of a name, and how many such names stand in one row


class Controls:
    """The panel of a session, the same in every browser.

    Args:
        gui: of the server.
        session: what is driven.
        rate: of the loop, to show.
    """

    def __init__(self, gui: viser.GuiApi, session: PlaySession, rate: Rate) -> None:
        self._gui, self._session, self._rate = gui, session, rate
        self._shown = session.latent
        self._status = gui.add_markdown("")
        self._add_clock()
        with gui.add_folder("skills"):
            self._add_skills()
        with gui.add_folder("latent"):
            self._latents = [self._latent_slider(dimension) for dimension in range(len(self._shown))]
        with gui.add_folder("goal and plan"):
            self._add_plan()
        with gui.add_folder("robot"):
            self._add_robot()

    def refresh(self) -> None:
        """Show how things stand; what others changed moves in every browser."""
        status = self._session.status()
        self._status.content = told(status, self._rate.frames_per_second())
        self._pause.label = "pause" if status.running else "go on"
        self._record.label = "record from the start" if status.recording is None else "stop and store"
        latent, goal = self._session.latent, self._session.goal
        if not np.array_equal(latent, self._shown):
            self._shown = latent
            for slider, value in zip(self._latents, latent, strict=True):
                _put(slider, float(value))
        if not np.allclose(self._goal.value, goal, atol=1e-3):
            _put(self._goal, tuple(np.round(goal, 3).tolist()))

    def _add_clock(self) -> None:
        self._pause = self._gui.add_button("pause")
        self._record = self._gui.add_button("record from the start", color="red")
        reset = self._gui.add_button("reset")
        self._on_click(reset, self._session.reset)
        self._on_click(self._pause, self._pause_or_go_on)
        self._on_click(self._record, self._toggle)

    def _pause_or_go_on(self) -> None:
        if self._session.status().running:
            self._session.pause()
        else:
            self._session.resume()

    def _toggle(self) -> None:
        if self._session.status().recording is None:
            self._session.record()
        else:
            self._session.stop_recording()

    def _add_skills(self) -> None:
        names = [line(name) for name in self._session.library.names]
        in_row = MANY if max(map(len, names)) <= SHORT else 1
        for first in range(0, len(names), in_row):
            row = names[first : first + in_row]
            group = self._gui.add_button_group("" if first else "hold", row)
            self._on_click(group, partial(self._hold, group, {name: first + place for place, name in enumerate(row)}))

    def _hold(self, group: Any, skills: dict[str, int]) -> None:
        self._session.hold_skill(skills[group.value])

    def _latent_slider(self, dimension: int) -> viser.GuiSliderHandle[float]:
        low, high = (float(end) for end in self._session.bounds[:, dimension])
        step = (high - low) / SLIDER_STEPS
        slider = self._gui.add_slider(f"z{dimension + 1}", low, high, step, float(self._shown[dimension]))

        def moved(value: float) -> None:
            latent = self._session.latent
            latent[dimension] = value
            self._session.hold_latent(latent)
            self._shown = self._session.latent

        self._on_update(slider, moved)
        return slider

    def _add_plan(self) -> None:
        self._goal = self._gui.add_vector3("goal, m", tuple(self._session.goal), step=0.005)
        self._on_update(self._goal, lambda value: self._session.set_goal(np.array(value)))
        method = self._gui.add_dropdown("method", methods())
        plan = self._gui.add_button("plan and play")
        self._on_click(plan, lambda: self._session.plan(method.value))
        text = self._gui.add_text("by hand", "", hint="as of compose --method sequence: 1,3 or 1:0.5,1~3:1,3:1")
        play = self._gui.add_button("play what is written")
        self._on_click(play, lambda: self._session.play_text(text.value))

    def _add_robot(self) -> None:
        session = self._session
        if session.library.world.spec.uses_robot:
            robot = self._gui.add_dropdown("robot", same_build(session))
            file = self._gui.add_text("robot file", "", hint="a path on the machine that runs skill; docs/robot-files.md")
            load = self._gui.add_button("take this file")
            self._on_update(robot, session.set_robot)
            self._on_click(load, lambda: session.set_robot(_path(file.value)))
        for knob in session.knobs:
            slider = self._gui.add_slider(knob.label, knob.low, knob.high, knob.step, session.values[knob.name])
            self._on_update(slider, partial(session.set_knob, knob.name))

    def _on_click(self, button: Any, act: Callable[[], Any]) -> None:
        def clicked(_: object) -> None:
            self._try(act)

        button.on_click(clicked)

    def _on_update(self, handle: Any, act: Callable[[Any], Any]) -> None:
        def updated(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # else it was set here
                self._try(lambda: act(event.target.value))

        handle.on_update(updated)

    def _try(self, act: Callable[[], Any]) -> None:
        """Do something; what goes wrong is shown to everybody."""
        try:
            act()
        except SkillError as error:
            self._session.say(error.message + (f": {error.hint}" if error.hint else ""))
        except Exception as error:
            self._session.say(f"failed: {type(error).__name__}: {error}")
            raise


def same_build(session: PlaySession) -> list[str]:
    """List the robots that can play the skills: the library's own, and bundled ones of its build."""
    source = session.library.world.robot
    found = [source.which]
    for name in bundled_robots():
        if name == source.which or len(describe_robot(name).joints) != source.joint_count:
            continue
        try:
            load_target(name, source)
        except UsageError:
            continue
        found.append(name)
    return found


def _put(handle: Any, value: object) -> None:
    """Set the value of an input in every browser; mypy does not see that it can be set."""
    handle.value = value


def _path(text: str) -> str:
    """Return a typed path, so that it is never taken for the name of a bundled robot."""
    if not text.strip():
        raise UsageError("no robot file is named", "type the path of a .toml file")
    return text.strip()


def told(status: Status, frames: float) -> str:
    """Return the status as markdown."""
    reached = "**reached**" if status.success else "not reached"
    moving = "running" if status.running else "the clock stands still"
    rows = [
        f"{moving} at {status.seconds:.2f} s · holds **{_plain(status.skill)}**",
        f"goal {reached}: {100 * status.distance:.1f} cm away, within {100 * status.tolerance:.1f} cm counts",
        "limits: " + (f"**violated: {', '.join(status.violated)}**" if status.violated else "kept")
        + (f" (since the start: {', '.join(status.violations)})" if status.violations else ""),
    ]  # fmt: skip
    if status.planning:
        rows.append(f"plans … {_plain(status.planning)}")
    if status.recording is not None:
        rows.append(f"**records**, {status.recording:.1f} s so far")
    if status.said:
        rows.append(_plain(status.said))
    return "\n\n".join([*rows, f"{frames:.0f} frames/s are sent"])


def _plain(text: str) -> str:
    """Return a text that markdown shows as it is."""
    return "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#|~$!" else letter for letter in line(text))
