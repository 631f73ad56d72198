"""Closed loop over segments: look at the target after each one, plan again from what is seen, and go on from there.

How late the target obeys is told from how it moved; the next plan is made for a robot that obeys as late. A box that begins to
tip ends the segment: see `reflex`.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillcli import metrics
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.composition.mpc import ModelPredictiveControl, MpcSettings, mpc_from
from skillcli.composition.plan import Segment
from skillcli.composition.planner import run
from skillcli.composition.registry import all_specs, method_spec
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

MARGIN = 0.8  # of the tolerance that the judge has: what the sensors show is off by millimetres
UNBREAKABLE = 3  # limits that every arm has; what an object adds comes behind
KEPT = ("box_pressed", "box_tipped")  # limits that a plan keeps; noise alone may break those of the arm
FRICTION = np.array([0.6, 1.0, 1.4, 1.4])  # factors of robots that must not break them either: where it is high a box tips
DOUBT = 0.01  # rad that their joints rest elsewhere than believed
PATIENCE = 0.5  # of an episode's time for coming as near as asked for; from then on what the judge takes is near enough
FIRST_LOOK = 4  # control steps after which a target is looked at first: how it obeys is not known before
OFF = 0.01  # m that a plan is expected to be off by as long as nothing was seen
GLANCE = 2  # control steps over which the speed of the judged point is seen: over one, noise would drown it


@dataclass
class Effort:
    """What planning again took."""

    plans: int = 0
    seconds: float = 0.0

    @property
    def mean(self) -> float | None:
        """Seconds per plan, None where nothing was planned."""
        return self.seconds / self.plans if self.plans else None


@dataclass(frozen=True)
class Prospect:
    """What is to be done next, and what the simulation says comes of it."""

    segment: Segment
    place: Array  # (3,) m, where the judged point should be behind it
    to_go: float  # m, what the whole plan leaves of the way


class Replanner:
    """Plans again and again, in simulations of its own, for a target that it knows through its sensors only.

    Args:
        library: the skills.
        recipe: how to plan.
        method: one whose plan can be made again.

    Raises:
        UsageError: it cannot.
    """

    def __init__(self, library: Library, recipe: Recipe, method: str) -> None:
        if not method_spec(method).replans:
            able = " or ".join(name for name, spec in all_specs().items() if spec.replans)
            raise UsageError(f"a plan of --method {method} cannot be made again on the way", f"--replan goes with {able}")
        robots = SampledRobots({"latency": np.zeros(1)})
        problem = problem_of(library, recipe, method, np.zeros((0, 3)), robots)
        settings = problem.settings
        if isinstance(settings, SearchSettings):
            # who looks again soon plans quickly: on the nominal robot, in the shortest segments
            settings = settings.model_copy(update={"segments": (min(settings.segments),)})
            problem = replace(problem, settings=settings)
            self._choices = choices_of(problem)
            slots, longest = recipe.transfer.replan_batch * len(self._choices.latent), settings.segments[0]
        else:
            own = problem.settings_as(MpcSettings)
            slots, longest = own.samples, own.segment
        self.problem, self.recipe, self.effort = problem, recipe, Effort()
        self.act = library.agent.act
        self._simulations = robots.make_env(library.world, slots)
        self._latency = 0.0  # s, of the simulations
        self._known = Identification(library.world)
        self._world = LatentEnvironment(self._simulations, self.act, limits=KEPT)
        self._others: Environment | None = None
        if isinstance(settings, SearchSettings) and self._simulations.violations().shape[1] > UNBREAKABLE:
            several = SampledRobots({"latency": np.zeros(len(FRICTION)), "contact_friction": FRICTION}, len(FRICTION))
            self._others = several.make_env(library.world, len(self._choices.latent))
            self._elsewhere = LatentEnvironment(self._others, self.act, len(FRICTION), KEPT)
        self.reflex: Reflex | None = None
        if isinstance(self._simulations, ArmEnvironment) and self._simulations.violations().shape[1] > UNBREAKABLE:
            self.reflex = Reflex(self._simulations)
        self._reckless = LatentEnvironment(self._simulations, self.act)
        self._longest = problem.steps(longest)

    def episode(self, target: Environment, waypoints: Array, steps: int, seed: int) -> Trajectories:
        """One episode on one target robot that stands at its start.

        Args:
            target: one simulation.
            waypoints: (W, 3) m.
            steps: control steps at most.
            seed: of methods that use chance.
        """
        target.desired_goal[:] = waypoints[-1]
        self._known.reset()
        self._set_latency(self._known.latency)
        mission = ReplannedEpisode(self, target, waypoints, round(PATIENCE * steps), generator(seed, "replanning"))
        recording, _ = rollout_closed_loop(target, mission.act, mission.condition, steps)
        if mission.gave_up():
            recording = replace(recording, gave_up=np.ones(1, dtype=bool))
        return recording.with_success(recording.success & met(recording, [waypoints], target.tolerance))

    def let_go(self, seen: StateEstimate) -> Array | None:
        """What lets go of a box that begins to tip, (1, J); None where nothing does."""
        return None if self.reflex is None else self.reflex.action(seen, self._known.sag)

    @property
    def goal_tolerance(self) -> float:
        """What is near enough to stop, m."""
        own = self.problem.settings
        assert isinstance(own, SearchSettings | MpcSettings)
        return min(own.goal_tolerance, self.problem.tolerance)

    @property
    def final_speed(self) -> float:
        """What is slow enough to stop, m/s; 0 for any speed."""
        own = self.problem.settings
        return own.final_speed if isinstance(own, SearchSettings) else 0.0

    def update(self, state: Array, applied: Sequence[Array], measured: Sequence[Array]) -> None:
        """Take account of a segment that is over, see `Identification`; plan for a robot that obeys like that."""
        self._known.update(state, applied, measured)
        self._set_latency(self._known.latency)

    def _set_latency(self, latency: float) -> None:
        """Let the simulations obey this late, s."""
        if latency != self._latency:
            late = {"latency": np.full(self._simulations.num_envs, latency)}
            self._simulations.randomize(late, np.random.default_rng(0))  # without noise there is nothing to draw
            if self._others is not None:
                friction = np.resize(FRICTION, self._others.num_envs)
                late = {"latency": np.full(len(friction), latency), "contact_friction": friction}
                self._others.randomize(late, np.random.default_rng(0))
            self._latency = latency

    def next(self, seen: StateEstimate, waypoints: Array, rng: np.random.Generator) -> Prospect:
        """The first segment of a new plan, and what comes of it; where every way breaks a limit, the limits are left out."""
        began = time.perf_counter()
        barred = self._barred(seen, rng)
        self._simulations.set_estimated_state(np.array([0]), seen.state, self._known.sag[None])
        row, points = self._world.start()
        planner = self._planner(row, points, waypoints, rng, barred)
        run(planner, self._world, lambda *_: None)
        if not planner.plan():
            planner = self._planner(row, points, waypoints, rng)
            run(planner, self._reckless, lambda *_: None)
        self.effort.plans += 1
        self.effort.seconds += time.perf_counter() - began
        plan = planner.plan()
        if not plan:  # every way fails: a moment of the first skill
            first = Segment(self.problem.mean[0], 0, self.problem.names[0], 1)
            return Prospect(first, points[0, 0], planner.remaining_length)
        return Prospect(replace(plan[0], steps=min(plan[0].steps, self._longest)), planner.next_place, planner.remaining_length)

    def _barred(self, seen: StateEstimate, rng: np.random.Generator) -> frozenset[int]:
        """Choices that break a limit of the box sooner than others do, held where it slides worse or better than believed."""
        if self._others is None:
            return frozenset()
        each, sag = (
            np.arange(len(FRICTION)),
            self._known.sag + DOUBT * rng.standard_normal((len(FRICTION), self._simulations.joints)),
        )
        self._others.set_estimated_state(each, np.repeat(seen.state, len(each), axis=0), sag)
        latent = self._choices.latent
        sim_states = np.tile(self._others.save(each).ravel(), (len(latent), 1))
        broken = self._elsewhere.hold(sim_states, latent, self._longest).failed.sum(axis=1)
        return frozenset(np.flatnonzero(broken > broken.min()).tolist())

    def _planner(
        self, row: Array, points: Array, waypoints: Array, rng: np.random.Generator, barred: Collection[int] = ()
    ) -> Expansions | ModelPredictiveControl:
        if isinstance(self.problem.settings, MpcSettings):
            return mpc_from(self.problem, row, points, waypoints, 1, rng)
        settings = self.recipe.transfer
        search = search_from(self.problem, row, points, waypoints, self._choices, settings.replan_budget, barred)
        return Expansions(search, settings.replan_batch)


class ReplannedEpisode:
    """One episode under way: which waypoints are behind it, and what is being held."""

    def __init__(
        self, replanner: Replanner, target: Environment, waypoints: Array, patience: int, rng: np.random.Generator
    ) -> None:
        self._replanner, self._target, self._waypoints, self._rng = replanner, target, waypoints, rng
        self._patience = patience  # control steps
        self._due = 0
        self._prospect: Prospect | None = None
        self._errors: list[float] = []  # m, how far the judged point came to lie from where a segment should have led it
        self._held, self._left = 0, 0  # control steps that the segment was held for, and still is
        self._looked, self._in_time = False, True
        self._path: list[Array] = []  # (3,) m, the judged point as it was seen
        self._begun: Array = np.zeros((1, 0))  # what was seen when the segment began
        self._applied: list[Array] = []
        self._measured: list[Array] = []  # since then, behind each step
        self._letting_go: Array | None = None  # (1, J) what is done instead of what the policy would
        if replanner.reflex is not None:
            replanner.reflex.reset(target.estimate_state())

    def act(self, observation: Array, latent: Array) -> Array:
        """What the policy does, unless the box begins to tip."""
        if self._letting_go is not None:
            return self._letting_go
        action: Array = self._replanner.act(observation, latent)
        return action

    def condition(self, _: int, failed: Array) -> tuple[Array, Array, Array] | None:
        """See `rollout_closed_loop`."""
        if failed[0]:
            self._in_time = False
            return None
        seen = self._target.estimate_state()
        self._path.append(seen.achieved_goal[0])
        if len(self._path) > 1 and self._letting_go is None:
            self._applied.append(self._target.applied[0].copy())
            self._measured.append(seen.state[0, : self._target.joints])
        self._letting_go = self._replanner.let_go(seen)
        if self._letting_go is not None:  # no latent is held, and a new plan begins behind it
            self._prospect, self._left, self._applied, self._measured = None, 0, [], []
            return np.zeros((1, self._replanner.problem.mean.shape[1])), np.array([-1]), np.array([True])
        if self._arrived():
            return None
        if self._left == 0 and not self._go_on(seen):
            return None
        assert self._prospect is not None
        segment = self._prospect.segment
        latent = segment.latents[self._held]
        self._held, self._left = self._held + 1, self._left - 1
        return latent[None], np.array([segment.skill]), np.array([True])

    def _go_on(self, seen: StateEstimate) -> bool:
        """Plan again; whether that is worth its while."""
        if self._prospect is not None and self._held == self._prospect.segment.steps:
            self._errors.append(float(np.linalg.norm(seen.achieved_goal[0] - self._prospect.place)))
        self._identify(seen)
        self._prospect = self._replanner.next(seen, self._waypoints[self._due :], self._rng)
        self._held, self._left = 0, self._prospect.segment.steps
        if not self._looked:
            self._left, self._looked = min(self._left, FIRST_LOOK), True
        return not (len(self._path) > 1 and self._near() and self._hopeless())

    def gave_up(self) -> bool:
        """Whether its time was over, and what is judged seemed not to be near."""
        self._path.append(self._target.estimate_state().achieved_goal[0])
        return self._in_time and not self._near()

    def _near(self) -> bool:
        """Whether the judge would take it, at the last waypoint."""
        return self._due == len(self._waypoints) - 1 and self._gap() <= MARGIN * self._target.tolerance

    def _hopeless(self) -> bool:
        """Whether the plan should end no nearer than here, with what plans of this episode were off by."""
        assert self._prospect is not None
        spread = float(np.sqrt(np.mean(np.square([OFF, *self._errors]))))
        return float(np.hypot(self._prospect.to_go, spread)) >= self._gap()

    def _gap(self) -> float:
        """To the waypoint that is due, as it was seen, m."""
        return float(np.linalg.norm(self._path[-1] - self._waypoints[self._due]))

    def _identify(self, seen: StateEstimate) -> None:
        """Learn from the segment that has ended how the target obeys."""
        self._replanner.update(self._begun, self._applied, self._measured)
        self._begun, self._applied, self._measured = seen.state, [], []

    def _arrived(self) -> bool:
        """Take note of a waypoint that is met; whether the last one is, slowly enough."""
        gap = self._gap()
        if self._due < len(self._waypoints) - 1:
            near = MARGIN * self._target.tolerance
            following = int(metrics.next_waypoint(self._due, self._path[-1], self._waypoints, near, keep_last=True))
            if following > self._due:
                self._due, self._left = following, 0  # what is being held was meant for the one before
            return False
        fastest = self._replanner.final_speed
        slow = not fastest or self._speed() <= fastest
        near = self._replanner.goal_tolerance
        if len(self._path) > self._patience:  # some places no sequence of latents comes nearer to
            near = max(near, MARGIN * self._target.tolerance)
        return gap <= near and slow and len(self._path) > 1

    def _speed(self) -> float:
        """Of the judged point as it was seen, m/s."""
        behind = self._path[-1 - min(GLANCE, len(self._path) - 1)]
        seconds = max(1, min(GLANCE, len(self._path) - 1)) * self._target.control_period
        return float(np.linalg.norm(self._path[-1] - behind)) / seconds
