"""Closed-loop execution: after each segment, estimate the state of the target and plan again from there.

The latency of the target is identified from its motion, and the next plan is made with this latency. When a box begins to
tip, the segment ends at once: see `reflex`.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.mpc import ModelPredictiveControl, MpcSettings, mpc_from
from skillcli.composition.plan import Choices, Segment
from skillcli.composition.planner import run
from skillcli.composition.problem import PlanningProblem
from skillcli.composition.registry import method_spec, replanning
from skillcli.composition.search import Expansions, SearchSettings, choices_of, search_from
from skillcli.errors import UsageError
from skillcli.evaluation.identification import Identification
from skillcli.evaluation.library import Library
from skillcli.evaluation.planning import aims_of, problem_of
from skillcli.evaluation.reflex import Reflex
from skillcli.evaluation.replanned_episode import LONGEST, MARGIN, Prospect, ReplannedEpisode, Sighting
from skillcli.evaluation.rollouts import met, rollout_closed_loop
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.evaluation.way_back import WayBack
from skillcli.kinds import COMPOSE
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import Environment, StateEstimate
from skillcli.store import Artifact
from skillcli.trajectories import Array, Trajectories

ARM_LIMITS = 3  # number of limits of an arm without an object; limits of the object follow
PLANNED_LIMITS = ("box_pressed", "box_tipped")  # limits that a plan keeps; sensor noise alone may violate those of the arm
# Contact friction of the robots that must keep these limits too: a box tips more easily where friction is high.
FRICTION = np.array([0.6, 1.0, 1.4, 1.4])
SAG_STD = 0.01  # rad, std of the resting offset of their joints


@dataclass
class Effort:
    """Cost of replanning."""

    plans: int = 0
    seconds: float = 0.0

    @property
    def mean(self) -> float | None:
        """Return the mean seconds per plan, None without plans."""
        return self.seconds / self.plans if self.plans else None


class Replanner:
    """Plans repeatedly, in its own simulations, for a target that it knows only through sensors.

    Args:
        library: the skills.
        recipe: settings of planner and replanning.
        method: a method that can plan again during an episode, see `method_of`.
    """

    def __init__(self, library: Library, recipe: Recipe, method: str) -> None:
        robots = SampledRobots({"latency": np.zeros(1)})
        problem = problem_of(library, recipe, method, np.zeros((0, 3)), robots)
        settings = problem.settings
        assert isinstance(settings, SearchSettings | MpcSettings)
        changed: dict[str, Any] = {"goal_tolerance": min(settings.goal_tolerance, MARGIN * problem.tolerance)}
        if isinstance(settings, SearchSettings):
            # frequent replanning must be fast: use the nominal robot and the shortest segments
            changed["segments"] = (min(settings.segments),)
        settings = settings.model_copy(update=changed)
        problem = replace(problem, settings=settings)
        if isinstance(settings, SearchSettings):
            offered = len(choices_of(problem).latent) + len(library.world.spec.aims(library.world.task, library.goals[0]))
            slots, longest = recipe.transfer.replan_batch * offered, settings.segments[0]
        else:
            slots, longest = settings.samples, settings.segment
        self.problem, self.recipe, self.effort, self._library = problem, recipe, Effort(), library
        self.act = library.agent.act
        self._simulations = robots.make_env(library.world, slots)
        self._latency = 0.0  # s, latency of the simulations
        self._known = Identification(library.world)
        self._world = LatentEnvironment(self._simulations, self.act, limits=PLANNED_LIMITS)
        self._others: Environment | None = None
        if isinstance(settings, SearchSettings) and self._simulations.violations().shape[1] > ARM_LIMITS:
            several = SampledRobots({"latency": np.zeros(len(FRICTION)), "contact_friction": FRICTION}, len(FRICTION))
            self._others = several.make_env(library.world, offered)
            self._elsewhere = LatentEnvironment(self._others, self.act, len(FRICTION), PLANNED_LIMITS)
        self._rng = np.random.default_rng(0)
        self.reflex, self.way_back = reflex_of(self._simulations), way_back_of(self._simulations)
        self._without_limits = LatentEnvironment(self._simulations, self.act)
        self._longest = problem.steps(longest)

    def episode(self, target: Environment, waypoints: Array, steps: int, seed: int) -> Trajectories:
        """Run one episode on one target robot, which is at its start.

        Args:
            target: one simulation.
            waypoints: (W, 3) m.
            steps: control steps; an episode that has come nearer within that time for one waypoint goes on, see `PROGRESS`.
            seed: of random methods.
        """
        target.desired_goal[:] = waypoints[-1]
        self.begin(seed)
        mission = ReplannedEpisode(self, target, waypoints, steps)
        recording, _ = rollout_closed_loop(target, mission.act, mission.condition, LONGEST * steps)
        if mission.gave_up():
            recording = replace(recording, gave_up=np.ones(1, dtype=bool))
        return recording.with_success(recording.success & met(recording, [waypoints], target.tolerance))

    def begin(self, seed: int) -> None:
        """Begin with another target, of which nothing is known."""
        self._known.reset()
        self._set_latency(self._known.latency)
        self._rng = generator(seed, "replanning")

    def ask(self, sighting: Sighting) -> None:
        """See `Adviser`: the answer is there at once."""
        self.update(sighting.begun, sighting.applied, sighting.measured)
        self._answer = self.next(sighting.seen, sighting.waypoints, self._rng, sighting.within)

    def answer(self) -> Prospect | None:
        """See `Adviser`."""
        return self._answer

    @property
    def latent_size(self) -> int:
        """See `Adviser`."""
        return int(self.problem.mean.shape[1])

    @property
    def sag(self) -> Array:
        """See `Adviser`."""
        return self._known.sag

    @property
    def goal_tolerance(self) -> float:
        """See `Adviser`."""
        own = self.problem.settings
        assert isinstance(own, SearchSettings | MpcSettings)
        return own.goal_tolerance

    @property
    def final_speed(self) -> float:
        """See `Adviser`."""
        own = self.problem.settings
        return own.final_speed if isinstance(own, SearchSettings) else 0.0

    def update(self, state: Array, applied: Sequence[Array], measured: Sequence[Array]) -> None:
        """Identify the target from a finished segment (see `Identification`) and plan with its latency."""
        self._known.update(state, applied, measured)
        self._set_latency(self._known.latency)

    def _set_latency(self, latency: float) -> None:
        """Set the latency of the simulations, s."""
        if latency != self._latency:
            nominal = {"latency": np.full(self._simulations.num_envs, latency)}
            self._simulations.randomize(nominal, np.random.default_rng(0))  # without noise nothing is drawn
            if self._others is not None:
                friction = np.resize(FRICTION, self._others.num_envs)
                varied = {"latency": np.full(len(friction), latency), "contact_friction": friction}
                self._others.randomize(varied, np.random.default_rng(0))
            self._latency = latency

    def next(self, seen: StateEstimate, waypoints: Array, rng: np.random.Generator, within: float | None = None) -> Prospect:
        """Plan the next segment and predict its result; if every plan violates a limit, plan without limits.

        Args:
            seen: where the target is.
            waypoints: (W, 3) m, still to be met.
            rng: of random methods.
            within: m from the last waypoint where the plan may end, `goal_tolerance` by default.
        """
        began = time.perf_counter()
        if self.problem.one_by_one and len(waypoints) > 1:
            waypoints, within = waypoints[:1], None
        choices = self._choices(waypoints)
        barred = self._barred(seen, choices, rng)
        self._simulations.set_estimated_state(np.array([0]), seen.state, self._known.sag[None])
        sim_state, keypoints = self._world.start()
        settings = self.problem.settings.model_copy(update={"goal_tolerance": within or self.goal_tolerance})
        problem = replace(self.problem, settings=settings)
        planner = self._planner(problem, sim_state, keypoints, waypoints, choices, rng, barred)
        run(planner, self._world, lambda *_: None)
        if not planner.plan():
            planner = self._planner(problem, sim_state, keypoints, waypoints, choices, rng)
            run(planner, self._without_limits, lambda *_: None)
        self.effort.plans += 1
        self.effort.seconds += time.perf_counter() - began
        plan = planner.plan()
        if not plan:  # every latent fails: hold the first skill for one step
            first = Segment(self.problem.mean[0], 0, self.problem.names[0], 1)
            return Prospect(first, keypoints[0, 0], planner.remaining_length)
        return Prospect(replace(plan[0], steps=min(plan[0].steps, self._longest)), planner.next_place, planner.remaining_length)

    def _choices(self, waypoints: Array) -> Choices | None:
        """Return the latents that a search tries on the way to waypoints (W, 3) m, None for a method that tries its own."""
        if not isinstance(self.problem.settings, SearchSettings):
            return None
        return choices_of(replace(self.problem, aims=aims_of(self._library, waypoints)))

    def _barred(self, seen: StateEstimate, choices: Choices | None, rng: np.random.Generator) -> frozenset[int]:
        """Return the choices that violate a limit of the box more often than others, over several values of friction."""
        if self._others is None or choices is None:
            return frozenset()
        robots = np.arange(len(FRICTION))
        sag = self._known.sag + SAG_STD * rng.standard_normal((len(robots), self._simulations.joints))
        self._others.set_estimated_state(robots, np.repeat(seen.state, len(robots), axis=0), sag)
        latent = choices.latent
        sim_states = np.tile(self._others.save(robots).ravel(), (len(latent), 1))
        broken = self._elsewhere.hold(sim_states, latent, self._longest).failed.sum(axis=1)
        return frozenset(np.flatnonzero(broken > broken.min()).tolist())

    def _planner(
        self, problem: PlanningProblem, sim_state: Array, keypoints: Array, waypoints: Array, choices: Choices | None,
        rng: np.random.Generator, barred: Collection[int] = (),
    ) -> Expansions | ModelPredictiveControl:  # fmt: skip
        if choices is None:
            return mpc_from(problem, sim_state, keypoints, waypoints, 1, rng)
        settings = self.recipe.transfer
        search = search_from(problem, sim_state, keypoints, waypoints, choices, settings.replan_budget, barred)
        return Expansions(search, settings.replan_batch)


def reflex_of(env: Environment) -> Reflex | None:
    """Return the reflex of an arm with an object that can tip, None for others; it uses the first simulation of `env`."""
    return Reflex(env) if isinstance(env, ArmEnvironment) and env.violations().shape[1] > ARM_LIMITS else None


def way_back_of(env: Environment) -> WayBack | None:
    """Return the way back of an arm that pushes an object, None for others; `env` is at its start."""
    return WayBack(env) if reflex_of(env) is not None and isinstance(env, ArmEnvironment) and not env.grasps else None


def method_of(source: Artifact) -> str:
    """Return the method by which a plan can be made again during an episode.

    Raises:
        UsageError: the artifact holds no plan, or its method cannot.
    """
    if not COMPOSE.is_kind_of(source):
        raise UsageError(
            f"{source.id} holds no plan, so there is nothing to plan again", "give a compose artifact, or leave --replan out"
        )
    method = COMPOSE.results_of(source).method
    if not method_spec(method).replans:
        raise UsageError(
            f"a plan of --method {method} cannot be made again during an episode",
            f"--replan goes with {' or '.join(replanning())}",
        )
    return method
