"""A policy that Stable-Baselines3 learned on `skill/Latent-v0` as a method of composition; nothing is learned here.

It needs no Stable-Baselines3. torch is imported only when the file is read, because it is slow to import.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skillcli.composition.latent_bounds import LatentBounds
from skillcli.composition.method import MethodSettings, MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.composition.plan import Segment
from skillcli.config.base import value
from skillcli.errors import SkillError, UsageError
from skillcli.paths import LONGEST_PATH, read_small

if TYPE_CHECKING:
    from skillcli.composition.latent_environment import LatentEnvironment
    from skillcli.learning.sb3_policy import Policy

MAX_BYTES = 1 << 26  # larger than the file of any small network


class Sb3Settings(MethodSettings):
    """Settings of a policy from Stable-Baselines3; durations as in the environment that it learned on."""

    policy: str = value("", "the .zip that model.save wrote", "", max_length=LONGEST_PATH)
    policy_sha256: str = value("", "of that file, filled in")
    segment: float = value(0.25, "how long one latent is held", "s", gt=0, le=60)
    seconds: float = value(2.0, "longest plan, for each waypoint of the route", "s", gt=0, le=600)
    goal_tolerance: float = value(0.02, "the plan ends within this of the last waypoint", "m", gt=0)


def plan(problem: PlanningProblem) -> PlanResult:
    """Let the policy choose one latent after the other.

    Raises:
        UsageError: no file is given, it cannot be read, or its policy learned on another kind of library.
    """
    from skillcli.learning.sb3_policy import read_policy

    settings = problem.settings_as(Sb3Settings)
    if not settings.policy:
        raise UsageError("no policy is given", "give its file: --method sb3:FILE.zip")
    policy = read_policy(Path(settings.policy), settings.policy_sha256)
    world = problem.make_world(1)
    segments = _play(problem, settings, policy, world)
    if not segments:
        raise SkillError("the first latent of the policy fails at once", "train it longer, or use another --method")
    return PlanResult(segments, world.held, world.control_steps * problem.period, weights=policy.arrays())


def _play(problem: PlanningProblem, settings: Sb3Settings, policy: Policy, world: LatentEnvironment) -> list[Segment]:
    """Hold what the policy chooses until the last waypoint is met, time is up, or a latent fails."""
    steps, route, bounds = problem.steps(settings.segment), problem.route, LatentBounds(problem.bounds)
    sim_state, keypoints = world.start()
    seen, waypoint, segments = world.observe(sim_state)[0], np.zeros((1, 1), dtype=int), list[Segment]()
    _check_sizes(settings.policy, policy.sizes, (seen.size + keypoints[0].size, problem.mean.shape[1]))
    for _ in range(problem.segments(settings.seconds, steps)):
        features = np.concatenate([seen, route.gap(waypoint[0], keypoints).ravel()])[None]
        latent = bounds.latent(policy(features))
        outcome = world.hold(sim_state[None], latent, steps)
        if outcome.failed.any():
            break
        progress = route.follow(waypoint, outcome.path, settings.goal_tolerance)
        arrived = int(progress.arrived[0])
        segments.append(Segment(latent[0].astype(float), -1, "latent", arrived or steps))
        if arrived:
            break
        sim_state, keypoints, seen = outcome.sim_states[0], outcome.path[0, :, -1], outcome.observation[0, 0]
        waypoint = progress.next_waypoint
    return segments


def _check_sizes(path: str, found: tuple[int, int], wanted: tuple[int, int]) -> None:
    if found != wanted:
        raise UsageError(
            f"{path} takes {found[0]} numbers and gives {found[1]}, expected {wanted[0]} and {wanted[1]}",
            "it has to learn on skill/Latent-v0 with this library",
        )


def _given(path: str) -> Sequence[str]:
    """Return the settings that name a file and its content."""
    if not path:
        raise UsageError("--method sb3: names no file", "give it: --method sb3:FILE.zip")
    try:
        digest = hashlib.sha256(read_small(Path(path), MAX_BYTES)).hexdigest()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", "") or error
        raise UsageError(
            f"{path} cannot be read: {reason}", "give the .zip that model.save of Stable-Baselines3 wrote"
        ) from None
    return [f"sb3.policy={json.dumps(path)}", f"sb3.policy_sha256={json.dumps(digest)}"]


METHOD = MethodSpec(
    name="sb3",
    settings=Sb3Settings,
    plan=plan,
    hint="train the policy longer, on goals like this one",
    options=(
        Option("policy", "The .zip that Stable-Baselines3 saved; --method sb3:FILE does the same.", "FILE", overrides=_given),
    ),
    argument="policy",
    on_target=True,
)
