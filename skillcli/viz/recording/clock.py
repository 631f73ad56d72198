"""The timelines of a recording: the chosen episodes one after another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import rerun as rr

from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.scene import Scene

PAUSE_S = 0.5  # rest between two episodes, so that their end is visible


class Clock(NamedTuple):
    """The place of one played episode on the timelines."""

    episode: int
    first_step: int
    start: float  # s
    time: Array  # (T+1,) s, of the playing recording; a source beside it may have another

    def columns(self, rows: slice) -> list[rr.TimeColumn]:
        """Return the time columns of these rows of the episode."""
        steps = np.arange(len(self.time))[rows]
        since = np.round(1e9 * (self.time[rows] - self.time[0] + self.start)).astype("timedelta64[ns]")
        return [
            rr.TimeColumn("step", sequence=steps + self.first_step),
            rr.TimeColumn("sim_time", duration=since),
        ]


def clocks(scene: Scene) -> list[Clock]:
    """Place the played episodes one after another."""
    time, played, step, start = scene.trajectories.time, list[Clock](), 0, 0.0
    for episode in motion.played(scene):
        played.append(Clock(episode, step, start, time))
        length = int(scene.trajectories.length[episode])
        step += length + 1
        start += float(time[length] - time[0]) + PAUSE_S
    return played
