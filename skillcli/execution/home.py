"""The way to the start: slow, straight in joint angles, and only where the model says that it is free."""

from __future__ import annotations

import numpy as np

from skillcli.errors import SkillError
from skillcli.execution.checks import AT_START
from skillcli.execution.filter import Limits
from skillcli.execution.loop import Arm
from skillcli.simulation.foresight import Foresight
from skillcli.trajectories import Array

SHARE = 0.1  # of the largest speed: somebody stands beside the arm
FASTEST = 0.2  # rad/s
SETTLING = 3.0  # s, within which the arm must have arrived after the last target


def move_home(arm: Arm, start: Array, limits: Limits, foresight: Foresight) -> None:
    """Move the arm to its start (J,) rad; when it has stopped on the way, `arm.stopped` says why.

    Args:
        arm: in its loop, begun.
        start: joint angles, rad.
        limits: of the arm.
        foresight: what it would touch.

    Raises:
        SkillError: the way is not free, or the arm does not arrive.
    """
    begin = arm.position.copy()
    if touched := foresight.on_the_way(begin, start):
        raise SkillError(
            f"the straight way to the start is not free: {touched} by our model", "move the arm nearer to the start by hand"
        )
    slowest = float((np.minimum(SHARE * limits.speed, FASTEST) * arm.control_period).min())  # rad in a control step
    steps = int(np.ceil(np.abs(start - begin).max() / slowest))
    for step in range(1, steps + 1):
        arm.go(begin + step / steps * (start - begin))
        if arm.stopped:
            return
    for _ in range(round(SETTLING / arm.control_period)):
        arm.go(start)
        if arm.stopped or np.abs(arm.position - start).max() <= AT_START:
            return
    off = float(np.abs(arm.position - start).max())
    raise SkillError(
        f"the arm did not arrive at its start: a joint is still {off:.3f} rad off after {SETTLING:g} s",
        "do its servos carry its weight? Is it held?",
    )
