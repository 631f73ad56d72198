"""Predict how often a plan succeeds when it is sent blindly to robots that differ, before it is sent to one."""

from __future__ import annotations

from collections.abc import Sequence

from skillcli import metrics
from skillcli.composition.plan import Plan
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library
from skillcli.evaluation.transfer_evaluator import TargetRobots, TransferEvaluator
from skillcli.kinds.compose import Prediction
from skillcli.simulation.domains import Domain
from skillcli.trajectories import Array

ROBOTS = 40  # the interval around 95 % is then 15 points wide, and a plan is judged in a second or two
SEED = 0  # of robots and sensor noise: all plans meet the same


def predict(library: Library, plan: Plan, routes: Sequence[Array], domain: Domain) -> Prediction:
    """Execute a plan open loop on `ROBOTS` robots of a domain, other ones than `skill transfer-eval` draws.

    Args:
        library: the skills.
        plan: its routes are executed in turn.
        routes: waypoints (W, 3) m of each route.
        domain: where the robots are drawn from.
    """
    schedule = EpisodeSchedule(*plan.schedules(), tuple(routes)).in_turn(ROBOTS)
    robots = TargetRobots.drawn(domain, ROBOTS, SEED, library.world.joints, use="predicted")
    recording = TransferEvaluator(library, SEED, library.world).run(schedule, robots)
    successes = int(recording.success.sum())
    return Prediction(
        domain=domain.name,
        robots=ROBOTS,
        successes=successes,
        successes_within_limits=int((recording.success & recording.within_limits).sum()),
        success_rate=successes / ROBOTS,
        ci95=metrics.wilson_interval(successes, ROBOTS),
    )
