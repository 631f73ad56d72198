"""Where a plan breaks the safety limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillcli.composition.plan import Plan, Segment, schedule
from skillcli.evaluation.library import Library
from skillcli.evaluation.rollouts import rollout_closed_loop
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.kinds.compose import BrokenLimit
from skillcli.kinds.record import point
from skillcli.trajectories import SAFETY_LIMITS, Array, Trajectories


def locate_violations(library: Library, plan: Plan, recording: Trajectories, robots: SampledRobots) -> tuple[BrokenLimit, ...]:
    """Each limit that each route (an episode of the recording) breaks: for how many control steps, and where first."""
    if recording.violations is None:
        return ()
    found = []
    for route in np.flatnonzero(recording.violations.any(axis=1)):
        broken, gripper = _watched(library, plan.routes[route], robots)
        ends = np.cumsum([segment.steps for segment in plan.routes[route]])
        for limit in np.flatnonzero(broken.any(axis=0)):
            step = int(broken[:, limit].argmax())
            found.append(
                BrokenLimit(
                    route=int(route),
                    limit=SAFETY_LIMITS[limit],
                    control_steps=int(broken[:, limit].sum()),
                    seconds=step * library.recipe.task.control_period,
                    segment=int(np.searchsorted(ends, step)),
                    gripper_m=point(gripper[step]),
                )
            )
    return tuple(found)


def _watched(library: Library, route: Sequence[Segment], robots: SampledRobots) -> tuple[Array, Array]:
    """The plan of one route once more, looked at after every control step.

    Returns:
        Limits broken, (T+1, K) bool, and the gripper, (T+1, 3) m.
    """
    env = robots.make_env(library.world, 1)
    latent, skill = schedule(route)
    broken, gripper = [], []

    def look() -> None:
        broken.append(env.violations()[0])
        gripper.append(env.recorded_state()["gripper_position"][0])

    def condition(t: int, _: Array) -> tuple[Array, Array, Array]:
        look()
        return latent[None, t], skill[None, t], np.array([True])

    rollout_closed_loop(env, library.agent.act, condition, len(skill))
    look()
    broken[0][:] = False  # no control step ends at the start
    return np.array(broken), np.array(gripper)
