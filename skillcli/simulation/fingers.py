"""Two fingers of a hand in N simulations."""

from __future__ import annotations

from typing import Any

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from skillcli.robots.scene import Hand

Array = NDArray[Any]


class Fingers:
    """Two fingers that slide alike, commanded by the width between them.

    Args:
        batch: N simulations.
        hand: names and limits of the fingers.
    """

    # The commanded width may lead the measured one by this much, m: fingers that hold something press with as much force as
    # their servos have at half of it each.
    MAX_LEAD = 0.02

    def __init__(self, batch: Batch, hand: Hand) -> None:
        model = batch.model
        joints, servos = [model.joint(name) for name in hand.joints], [model.actuator(name).id for name in hand.servos]
        self.widest = hand.widest
        self._axis = batch.bind("xaxis")[:, joints[0].id]
        self._position, self._qpos = [joint.qposadr[0] for joint in joints], batch.bind("qpos")
        self._command, self._ctrl = model.actuator_ctrladr[servos], batch.bind("ctrl")
        self._low, self._high = model.actuator_ctrlrange[self._command].sum(axis=0)

    @property
    def position(self) -> Array:
        """Return how far each finger is open, (N, 2) m."""
        position: Array = self._qpos[:, self._position]
        return position

    @property
    def width(self) -> Array:
        """Return the width between the fingers, (N,) m."""
        width: Array = self.position.sum(axis=1)
        return width

    @property
    def commanded(self) -> Array:
        """Return the commanded width, (N,) m; below the width of what is held."""
        width: Array = self._ctrl[:, self._command].sum(axis=1)
        return width

    @property
    def axis(self) -> Array:
        """Return the direction in which the first finger opens, unit vectors (N, 3) in the base frame; a live view."""
        axis: Array = self._axis
        return axis

    def set_state(self, ids: Array, hand: Array) -> None:
        """Set widths and commanded widths, (n, 2) m."""
        self._qpos[np.ix_(ids, self._position)] = hand[:, :1] / 2
        self._ctrl[np.ix_(ids, self._command)] = np.clip(hand[:, 1:], self._low, self._high) / 2

    def move(self, increment: Array) -> Array:
        """Add increments (N,) m to the commanded widths; return how far these moved, (N,) m.

        A command stays within `MAX_LEAD` of the width, and within the range of the servos.
        """
        width, before, lead = self.width, self.commanded, self.MAX_LEAD
        target = np.clip(np.clip(before + increment, width - lead, width + lead), self._low, self._high)
        self._ctrl[:, self._command] = target[:, None] / 2
        moved: Array = target - before
        return moved
