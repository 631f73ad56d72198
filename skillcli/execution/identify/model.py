"""Predict a log: start simulated arms where it says the arm was, send them its commands, and read their joint angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

import numpy as np

from skillcli.execution.identify.windows import Windows
from skillcli.execution.log import Log
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.replay import REMEMBERED, Replay, Start
from skillcli.trajectories import Array

Parameters = Mapping[str, Array]


class Meaning(Enum):
    """What the commands of a log mean."""

    TARGETS = "joint angles"
    ADDED = "increments that add to the command"
    RESTARTED = "increments that add to the measured joint angle"


class Model:
    """A log on simulated arms.

    Args:
        log: what was measured and sent.
        replay: the simulated arms.
    """

    def __init__(self, log: Log, replay: Replay) -> None:
        self.log, self._replay = log, replay
        self._speed = log.speed
        self._start = np.repeat(log.starts, [rows.stop - rows.start for rows in log.episodes])  # (T,) first row of its episode

    @property
    def physics_step(self) -> float:
        """Return the time step of the physics, s."""
        return self._replay.physics_step

    def measured(self, windows: Windows) -> Array:
        """Return what a prediction is compared with, (W, L, J) rad; past the end of an episode its last row."""
        rows = np.minimum(windows.rows, len(self.log.stamps) - 1)
        angles: Array = self.log.position[rows]
        return angles

    def predict(self, windows: Windows, meaning: Meaning, parameters: Sequence[Parameters]) -> Array:
        """Return the predicted joint angles on each of P parameters, (P, W, L, J) rad."""
        restart = {"command_restart": np.array(1.0)} if meaning is Meaning.RESTARTED else {}
        responses = np.array([np.broadcast_to(given.get("command_response", 1.0), self.log.joints) for given in parameters])
        if (responses == responses[0]).all():
            responses = responses[:1]
        before = windows.first[:, None] - np.arange(REMEMBERED, 0, -1)  # (W, c)
        begin = self._start[windows.first][:, None]
        history = self.commanded(meaning, responses)[:, np.maximum(before, begin)]
        # before an episode the arm stood where it was told to
        commands = np.where((before < begin)[None, ..., None], self.log.position[begin][None], history)
        rows = np.minimum(windows.first[:, None] + np.arange(windows.length), len(self.log.stamps) - 1)
        start = Start(self.log.position[windows.first], self._speed[windows.first], commands, self.log.sent[rows])
        return self._replay.run(start, [{**given, **restart} for given in parameters], self.log.increments)

    def commanded(self, meaning: Meaning, responses: Array) -> Array:
        """Return the commanded joint angles after each row, (P, T, J) rad, for responses (P, J)."""
        if meaning is Meaning.TARGETS:
            return np.asarray(self.log.sent[None])
        limit = self._replay.action_limit
        moved: Array = responses[:, None] * np.clip(self.log.sent, -limit, limit)  # (P, T, J)
        if meaning is Meaning.RESTARTED:
            return self.log.position + moved
        lead = ArmBatch.MAX_TRACKING_ERROR
        commanded, first = np.empty_like(moved), set(self.log.starts)
        now = np.zeros_like(moved[:, 0])
        for row, position in enumerate(self.log.position):
            now = (position if row in first else now) + moved[:, row]
            now = commanded[:, row] = np.clip(now, position - lead, position + lead)
        return commanded
