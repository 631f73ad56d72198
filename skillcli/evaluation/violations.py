"""Locate the states where a plan violates the safety limits."""

from __future__ import annotations

import numpy as np

from skillcli.composition.plan import Plan
from skillcli.kinds.compose import Violation
from skillcli.kinds.record import point
from skillcli.trajectories import Trajectories


def locate_violations(plan: Plan, recording: Trajectories) -> tuple[Violation, ...]:
    """Return each limit that each route (an episode of the recording) violates: control steps, and the first place."""
    found = []
    for route, first in enumerate(recording.first_violations):
        ends = np.cumsum([segment.steps for segment in plan.routes[route]])
        for limit, step in first.items():
            assert recording.gripper_position is not None, "only arms have limits"
            found.append(
                Violation(
                    route=route,
                    limit=limit,
                    control_steps=int(recording.violation_steps[limit][route]),
                    seconds=float(recording.time[step + 1]),
                    segment=int(np.searchsorted(ends, step, side="right")),
                    gripper_m=point(recording.gripper_position[route, step + 1]),
                )
            )
    return tuple(found)
