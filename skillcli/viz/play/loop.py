"""The clock of a play: control steps in real time, and some frames for each of them."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.state import Pose

FRAMES = 40.0  # frames/s at least
WINDOW = 100  # frames over which the rate is measured


@dataclass
class Rate:
    """How well the loop keeps its time."""

    ends: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))  # s
    skipped: int = 0  # control steps that came so late that the clock was set anew

    def frames_per_second(self) -> float:
        """Return the frames/s of the last frames; 0 before there are two."""
        return (len(self.ends) - 1) / (self.ends[-1] - self.ends[0]) if len(self.ends) > 1 else 0.0


def run(session: PlaySession, draw: Callable[[Pose], None], stop: Callable[[], bool], rate: Rate) -> None:
    """Run a session until `stop` says so; nothing that a browser does can make it wait.

    The arm is drawn one control step late, on its way between the last two states.

    Args:
        session: its control period may change with its robot.
        draw: called with every frame; must not block.
        stop: asked before every control step.
        rate: is kept up to date.
    """
    due = time.monotonic()
    while not stop():
        frames = max(1, math.ceil(session.period * FRAMES))
        session.step()
        for frame in range(frames):
            draw(session.pose((frame + 1) / frames))
            rate.ends.append(time.monotonic())
            due += session.period / frames
            time.sleep(max(0.0, due - time.monotonic()))
        if time.monotonic() > due + session.period:  # the machine was busy: go on from now, do not hurry after
            rate.skipped += 1
            due = time.monotonic()
