"""Play one episode on an arm that is looked at after every segment, and holds while a planner thinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skillcli.evaluation.replanned_episode import LONGEST, ReplannedEpisode
from skillcli.evaluation.rollouts import met, rollout_closed_loop
from skillcli.execution.filter import Stop
from skillcli.execution.loop import Arm
from skillcli.execution.planner import PlannerLost, PlannerProcess
from skillcli.trajectories import Array, Trajectories

SETTLE = 0.3  # s, in which an arm comes to rest at its target before it is looked at: three time constants of its servos
MOST_WAITING = 100  # times the longest episode, in all: the recording ends there


def moving_steps(planner: PlannerProcess, waypoints: Array, share: float) -> float:
    """Return in how many control steps of an episode to waypoints (W, 3) the arm moves at most; while it holds, none count."""
    return LONGEST * planner.steps * len(waypoints) / share


def play_replanned(arm: Arm, planner: PlannerProcess, waypoints: Array, seed: int, share: float = 1.0) -> Trajectories:
    """Play one episode on an arm at its start.

    Args:
        arm: in its loop, begun.
        planner: ready.
        waypoints: (W, 3) m.
        seed: of random methods.
        share: of every action that the arm carries out.
    """
    arm.desired_goal[:] = waypoints[-1]
    planner.begin(seed)
    steps, settle = planner.steps * len(waypoints), round(SETTLE / arm.control_period)
    mission = ReplannedEpisode(planner, arm, waypoints, steps, share, settle)

    def condition(t: int, failed: Array) -> tuple[Array, Array, Array] | None:
        if arm.stopped is not None and t > 0:
            return None
        try:
            return mission.condition(t, failed)
        except PlannerLost as error:
            arm.stop(Stop("planner_lost", error.message))
            # every recording has a step
            return None if t else (np.zeros((1, planner.latent_size)), np.array([-1]), np.array([True]))

    most = round(MOST_WAITING * moving_steps(planner, waypoints, share))
    recording, _ = rollout_closed_loop(arm, mission.act, condition, most)
    whole = arm.stopped is None
    if whole and mission.gave_up():
        recording = replace(recording, gave_up=np.ones(1, dtype=bool))
    return recording.with_success(recording.success & whole & met(recording, [waypoints], arm.tolerance))
