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

from skillcli import metrics
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.mpc import ModelPredictiveControl, MpcSettings, mpc_from
from skillcli.composition.plan import Segment
from skillcli.composition.planner import run
from skillcli.composition.registry import method_spec, replanning
from skillcli.composition.search import Expansions, SearchSettings, choices_of, search_from
from skillcli.errors import UsageError
from skillcli.evaluation.identification import Identification
from skillcli.evaluation.library import Library
from skillcli.evaluation.planning import problem_of
from skillcli.evaluation.reflex import Reflex
from skillcli.evaluation.rollouts import met, rollout_closed_loop
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import Environment, StateEstimate
from skillcli.trajectories import Array, Trajectories

MARGIN = 0.8  # of the tolerance of success: sensors are off by millimetres
ARM_LIMITS = 3  # number of limits of an arm without an object; limits of the object follow
PLANNED_LIMITS = ("box_pressed", "box_tipped")  # limits that a plan keeps; sensor noise alone may violate those of the arm
# Contact friction of the robots that must keep these limits too: a box tips more easily where friction is high.
FRICTION = np.array([0.6, 1.0, 1.4, 1.4])
SAG_STD = 0.01  # rad, std of the resting offset of their joints
PATIENCE = 0.5  # of an episode's time spent on reaching the planner's goal tolerance; afterwards the task's tolerance is enough
FIRST_LOOK = 4  # control steps before the first replanning, because nothing is known of the target yet
PROGRESS = 0.01  # m, by which an episode must have come nearer to be given more time
LONGEST = 3  # times its own time, an episode that still comes nearer
EXPECTED_ERROR = 0.01  # m, expected error of a plan before the first measurement
SPEED_WINDOW = 2  # control steps over which the speed of the achieved goal is measured: over one, noise would dominate


@dataclass
class Effort:
    """Cost of replanning."""

    plans: int = 0
    seconds: float = 0.0

    @property
    def mean(self) -> float | None:
        """Return the mean seconds per plan, None without plans."""
        return self.seconds / self.plans if self.plans else None


@dataclass(frozen=True)
class Prospect:
    """The next segment, and its predicted result."""

    segment: Segment
    place: Array  # (3,) m, predicted achieved goal after the segment
    to_go: float  # m, way that is still to go once the whole plan has been executed


class Replanner:
    """Plans repeatedly, in its own simulations, for a target that it knows only through sensors.

    Args:
        library: the skills.
        recipe: settings of planner and replanning.
        method: a method that can plan again during an episode.

    Raises:
        UsageError: the method cannot.
    """

    def __init__(self, library: Library, recipe: Recipe, method: str) -> None:
        if not method_spec(method).replans:
            raise UsageError(
                f"a plan of --method {method} cannot be made again during an episode",
                f"--replan goes with {' or '.join(replanning())}",
            )
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
            self._choices = choices_of(problem)
            slots, longest = recipe.transfer.replan_batch * len(self._choices.latent), settings.segments[0]
        else:
            slots, longest = settings.samples, settings.segment
        self.problem, self.recipe, self.effort = problem, recipe, Effort()
        self.act = library.agent.act
        self._simulations = robots.make_env(library.world, slots)
        self._latency = 0.0  # s, latency of the simulations
        self._known = Identification(library.world)
        self._world = LatentEnvironment(self._simulations, self.act, limits=PLANNED_LIMITS)
        self._others: Environment | None = None
        if isinstance(settings, SearchSettings) and self._simulations.violations().shape[1] > ARM_LIMITS:
            several = SampledRobots({"latency": np.zeros(len(FRICTION)), "contact_friction": FRICTION}, len(FRICTION))
            self._others = several.make_env(library.world, len(self._choices.latent))
            self._elsewhere = LatentEnvironment(self._others, self.act, len(FRICTION), PLANNED_LIMITS)
        self.reflex: Reflex | None = None
        if isinstance(self._simulations, ArmEnvironment) and self._simulations.violations().shape[1] > ARM_LIMITS:
            self.reflex = Reflex(self._simulations)
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
        self._known.reset()
        self._set_latency(self._known.latency)
        mission = ReplannedEpisode(self, target, waypoints, steps, generator(seed, "replanning"))
        recording, _ = rollout_closed_loop(target, mission.act, mission.condition, LONGEST * steps)
        if mission.gave_up():
            recording = replace(recording, gave_up=np.ones(1, dtype=bool))
        return recording.with_success(recording.success & met(recording, [waypoints], target.tolerance))

    def let_go(self, seen: StateEstimate) -> Array | None:
        """Return the action that releases a box that begins to tip, (1, J); None if there is nothing to release."""
        return None if self.reflex is None else self.reflex.action(seen, self._known.sag)

    @property
    def goal_tolerance(self) -> float:
        """Distance at which the episode may stop, as the sensors tell it, m."""
        own = self.problem.settings
        assert isinstance(own, SearchSettings | MpcSettings)
        return own.goal_tolerance

    @property
    def final_speed(self) -> float:
        """Highest speed at which the episode may stop, m/s; 0 for any."""
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

    def next(self, seen: StateEstimate, waypoints: Array, rng: np.random.Generator) -> Prospect:
        """Plan the next segment and predict its result; if every plan violates a limit, plan without limits."""
        began = time.perf_counter()
        barred = self._barred(seen, rng)
        self._simulations.set_estimated_state(np.array([0]), seen.state, self._known.sag[None])
        sim_state, keypoints = self._world.start()
        planner = self._planner(sim_state, keypoints, waypoints, rng, barred)
        run(planner, self._world, lambda *_: None)
        if not planner.plan():
            planner = self._planner(sim_state, keypoints, waypoints, rng)
            run(planner, self._without_limits, lambda *_: None)
        self.effort.plans += 1
        self.effort.seconds += time.perf_counter() - began
        plan = planner.plan()
        if not plan:  # every latent fails: hold the first skill for one step
            first = Segment(self.problem.mean[0], 0, self.problem.names[0], 1)
            return Prospect(first, keypoints[0, 0], planner.remaining_length)
        return Prospect(replace(plan[0], steps=min(plan[0].steps, self._longest)), planner.next_place, planner.remaining_length)

    def _barred(self, seen: StateEstimate, rng: np.random.Generator) -> frozenset[int]:
        """Return the choices that violate a limit of the box more often than others, over several values of friction."""
        if self._others is None:
            return frozenset()
        robots = np.arange(len(FRICTION))
        sag = self._known.sag + SAG_STD * rng.standard_normal((len(robots), self._simulations.joints))
        self._others.set_estimated_state(robots, np.repeat(seen.state, len(robots), axis=0), sag)
        latent = self._choices.latent
        sim_states = np.tile(self._others.save(robots).ravel(), (len(latent), 1))
        broken = self._elsewhere.hold(sim_states, latent, self._longest).failed.sum(axis=1)
        return frozenset(np.flatnonzero(broken > broken.min()).tolist())

    def _planner(
        self, sim_state: Array, keypoints: Array, waypoints: Array, rng: np.random.Generator, barred: Collection[int] = ()
    ) -> Expansions | ModelPredictiveControl:
        if isinstance(self.problem.settings, MpcSettings):
            return mpc_from(self.problem, sim_state, keypoints, waypoints, 1, rng)
        settings = self.recipe.transfer
        search = search_from(self.problem, sim_state, keypoints, waypoints, self._choices, settings.replan_budget, barred)
        return Expansions(search, settings.replan_batch)


class ReplannedEpisode:
    """One running episode: the waypoints met so far, and the segment being held."""

    def __init__(
        self, replanner: Replanner, target: Environment, waypoints: Array, steps: int, rng: np.random.Generator
    ) -> None:
        self._replanner, self._target, self._waypoints, self._rng = replanner, target, waypoints, rng
        self._steps, self._patience = steps, round(PATIENCE * steps)  # control steps
        self._next_waypoint = 0  # index of the waypoint to meet next
        self._nearest, self._nearest_at = np.inf, 0  # m, smallest distance to it, and after how many control steps
        self._prospect: Prospect | None = None
        self._errors: list[float] = []  # m, distance between measured and predicted achieved goal after each segment
        self._held, self._left = 0, 0  # control steps that the segment was held, and is still to be held
        self._first_plan_made, self._failed = False, False
        self._path: list[Array] = []  # (3,) m, estimated achieved goal at each step
        self._begun: Array = np.zeros((1, 0))  # estimated state at the start of the segment
        self._applied: list[Array] = []
        self._measured: list[Array] = []  # joint angles after each step of the segment
        self._letting_go: Array | None = None  # (1, J) action of the reflex, which replaces the policy's
        if replanner.reflex is not None:
            replanner.reflex.reset(target.estimate_state())

    def act(self, observation: Array, latent: Array) -> Array:
        """Return the action of the policy, or of the reflex if the box begins to tip."""
        if self._letting_go is not None:
            return self._letting_go
        action: Array = self._replanner.act(observation, latent)
        return action

    def condition(self, _: int, failed: Array) -> tuple[Array, Array, Array] | None:
        """See `rollout_closed_loop`."""
        if failed[0]:
            self._failed = True
            return None
        seen = self._target.estimate_state()
        self._path.append(seen.achieved_goal[0])
        if len(self._path) > 1 and self._letting_go is None:
            self._applied.append(self._target.applied[0].copy())
            self._measured.append(seen.state[0, : self._target.joints])
        self._letting_go = self._replanner.let_go(seen)
        if self._letting_go is not None:  # the reflex holds no latent, and a new plan begins after it
            self._prospect, self._left, self._applied, self._measured = None, 0, [], []
            return np.zeros((1, self._replanner.problem.mean.shape[1])), np.array([-1]), np.array([True])
        if self._arrived() or self._time_is_up():
            return None
        if self._left == 0 and not self._go_on(seen):
            return None
        assert self._prospect is not None
        segment = self._prospect.segment
        latent = segment.latents[self._held]
        self._held, self._left = self._held + 1, self._left - 1
        return latent[None], np.array([segment.skill]), np.array([True])

    def _go_on(self, seen: StateEstimate) -> bool:
        """Plan again; return whether the new segment is worth executing."""
        if self._prospect is not None and self._held == self._prospect.segment.steps:
            self._errors.append(float(np.linalg.norm(seen.achieved_goal[0] - self._prospect.place)))
        self._identify(seen)
        self._prospect = self._replanner.next(seen, self._waypoints[self._next_waypoint :], self._rng)
        self._held, self._left = 0, self._prospect.segment.steps
        if not self._first_plan_made:
            self._left, self._first_plan_made = min(self._left, FIRST_LOOK), True
        return not (len(self._path) > 1 and self._near() and self._hopeless())

    def _time_is_up(self) -> bool:
        """Note how near the waypoint is; return whether all the time has passed, and that of one waypoint without progress."""
        passed = len(self._path) - 1
        if self._gap() < self._nearest - PROGRESS:
            self._nearest, self._nearest_at = self._gap(), passed
        return passed >= self._steps and passed - self._nearest_at >= self._steps // len(self._waypoints)

    def gave_up(self) -> bool:
        """Return whether time ran out while the achieved goal still seemed too far from the target."""
        self._path.append(self._target.estimate_state().achieved_goal[0])
        return not self._failed and not self._near()

    def _near(self) -> bool:
        """Whether the achieved goal is within the task's tolerance of the last waypoint."""
        return self._next_waypoint == len(self._waypoints) - 1 and self._gap() <= MARGIN * self._target.tolerance

    def _hopeless(self) -> bool:
        """Whether the plan is expected to end no nearer than the present position, given the errors of earlier plans."""
        assert self._prospect is not None
        spread = float(np.sqrt(np.mean(np.square([EXPECTED_ERROR, *self._errors]))))
        return float(np.hypot(self._prospect.to_go, spread)) >= self._gap()

    def _gap(self) -> float:
        """Return the estimated distance to the next waypoint, m."""
        return float(np.linalg.norm(self._path[-1] - self._waypoints[self._next_waypoint]))

    def _identify(self, seen: StateEstimate) -> None:
        """Identify the target from the segment that has just ended."""
        self._replanner.update(self._begun, self._applied, self._measured)
        self._begun, self._applied, self._measured = seen.state, [], []

    def _arrived(self) -> bool:
        """Record a waypoint that is met; return whether the last one is, at a low enough speed."""
        gap = self._gap()
        if self._next_waypoint < len(self._waypoints) - 1:
            met_within = MARGIN * self._target.tolerance
            following = int(
                metrics.next_waypoint(self._next_waypoint, self._path[-1], self._waypoints, met_within, keep_last=True)
            )
            if following > self._next_waypoint:
                self._next_waypoint, self._left = following, 0  # the rest of the segment was planned for the previous waypoint
                self._nearest, self._nearest_at = np.inf, len(self._path) - 1
            return False
        fastest = self._replanner.final_speed
        slow = not fastest or self._speed() <= fastest
        allowed_gap = self._replanner.goal_tolerance
        if len(self._path) > self._patience:  # the skills cannot come closer to some places
            allowed_gap = max(allowed_gap, MARGIN * self._target.tolerance)
        return gap <= allowed_gap and slow and len(self._path) > 1

    def _speed(self) -> float:
        """Return the estimated speed of the achieved goal, m/s."""
        behind = self._path[-1 - min(SPEED_WINDOW, len(self._path) - 1)]
        seconds = max(1, min(SPEED_WINDOW, len(self._path) - 1)) * self._target.control_period
        return float(np.linalg.norm(self._path[-1] - behind)) / seconds
