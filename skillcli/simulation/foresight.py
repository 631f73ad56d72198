"""What an arm would touch at given joint angles, from its model alone: asked before it is sent there."""

from __future__ import annotations

import numpy as np

from skillcli.robots.posture import overlaps, posed
from skillcli.robots.robot import Robot
from skillcli.simulation.safety import Clearance
from skillcli.trajectories import Array

TABLE, ITSELF = "table_clearance", "self_collision"


class Foresight:
    """Kinematics and collisions of one arm behind its table.

    Args:
        robot: the arm.
        start: joint angles (J,) rad at which it is known to stand freely: parts that overlap there always do.
    """

    def __init__(self, robot: Robot, start: Array) -> None:
        self._model = robot.model
        self._data = posed(self._model, robot.names, tuple(start))
        self._qpos = np.array([self._model.joint(name).qposadr[0] for name in robot.names.joints])
        self._clearance = Clearance(self._model)
        self._table = self._model.geom("table").id
        self._usual = overlaps(self._model, self._data)

    def touches(self, angles: Array) -> str:
        """Return `TABLE` or `ITSELF` if the arm would touch one of them at angles (J,) rad, else ""."""
        self._data.qpos[self._qpos] = angles
        pairs = overlaps(self._model, self._data) - self._usual
        deep = self._clearance.depth(self._data.geom_xpos[None], self._data.geom_xmat[None])[0]
        if deep > 0 or any(self._table in pair for pair in pairs):
            return TABLE
        return ITSELF if pairs else ""

    def on_the_way(self, start: Array, end: Array, step: float = 0.02) -> str:
        """Return what it would touch first on a straight line between joint angles (J,) rad, "" for nothing.

        Args:
            start: where the line begins.
            end: where it ends.
            step: largest change of a joint from one tested posture to the next, rad.
        """
        count = 1 + int(np.abs(end - start).max() / step)
        for share in np.linspace(0, 1, count + 1):
            if touched := self.touches(start + share * (end - start)):
                return touched
        return ""
