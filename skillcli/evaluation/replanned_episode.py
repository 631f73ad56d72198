"""One replanned episode: look after every segment, let somebody plan, and hold still until the plan is there.

In the simulation a plan is there at once. Beside a real arm it takes longer than a control step: the arm then comes to rest
where it was sent, is looked at, and holds its target while the planner thinks. Such control steps do not count as time of the
episode.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skillcli import metrics
from skillcli.composition.plan import Segment
from skillcli.evaluation.reflex import Reflex
from skillcli.evaluation.way_back import WayBack
from skillcli.simulation.environment import StateEstimate
from skillcli.trajectories import Array

MARGIN = 0.8  # of the tolerance of success: sensors are off by millimetres
PATIENCE = 0.5  # of an episode's time spent on reaching the planner's goal tolerance; afterwards the task's tolerance is enough
FIRST_LOOK = 4  # control steps before the first replanning, because nothing is known of the target yet
PROGRESS = 0.01  # m, by which an episode must have come nearer to be given more time
STUCK = 0.5  # of the time for a waypoint, without coming nearer by that: then the arm begins anew from its start
LONGEST = 3  # times its own time, an episode that still comes nearer
EXPECTED_ERROR = 0.01  # m, expected error of a plan before the first measurement
SPEED_WINDOW = 2  # control steps over which the speed of the achieved goal is measured: over one, noise would dominate


@dataclass(frozen=True)
class Prospect:
    """The next segment, and its predicted result."""

    segment: Segment
    place: Array  # (3,) m, predicted achieved goal after the segment
    to_go: float  # m, way that is still to go once the whole plan has been executed


@dataclass(frozen=True)
class Sighting:
    """What a planner is told: where the target is, and how it moved since the last segment began.

    Attributes:
        seen: estimated state now.
        begun: (1, v) estimated state at the beginning of that segment.
        applied: increments (J,) rad of each control step since.
        measured: joint angles (J,) rad after each of them.
        waypoints: (W, 3) m, still to be met.
        within: m from the last one, where a plan may end.
    """

    seen: StateEstimate
    begun: Array
    applied: Sequence[Array]
    measured: Sequence[Array]
    waypoints: Array
    within: float


class Target(Protocol):
    """One robot, simulated or real, as an episode sees it."""

    joints: int
    tolerance: float
    control_period: float
    applied: Array

    def estimate_state(self) -> StateEstimate:
        """Estimate the state from the sensors."""


class Adviser(Protocol):
    """Whoever plans for an episode."""

    reflex: Reflex | None  # releases a box that begins to tip
    way_back: WayBack | None  # leads to the start, from where the episode gets no nearer

    @property
    def latent_size(self) -> int:
        """Return the size of a latent, d."""

    @property
    def goal_tolerance(self) -> float:
        """Return the distance at which the episode may stop, as the sensors tell it, m."""

    @property
    def final_speed(self) -> float:
        """Return the highest speed at which the episode may stop, m/s; 0 for any."""

    @property
    def sag(self) -> Array:
        """Return how far the joints are known to rest from their commands, (J,) rad."""

    def act(self, observation: Array, latent: Array) -> Array:
        """Return the action of the policy."""

    def ask(self, sighting: Sighting) -> None:
        """Ask for the next segment; an answer to an earlier question is no longer wanted."""

    def answer(self) -> Prospect | None:
        """Return the answer to the last question, None if it is not there yet."""


class ReplannedEpisode:
    """One running episode: the waypoints met so far, and the segment being held.

    Args:
        adviser: plans.
        target: one robot, at its start.
        waypoints: (W, 3) m.
        steps: control steps, see `Replanner.episode`.
        share: of every action that the target carries out; latents are held longer in turn.
        settle: control steps in which the target comes to rest before it is looked at, because it has to hold then.
    """

    def __init__(
        self, adviser: Adviser, target: Target, waypoints: Array, steps: int, share: float = 1.0, settle: int = 0
    ) -> None:
        self._adviser, self._target, self._waypoints = adviser, target, waypoints
        self._share, self._settle = share, settle
        self._steps, self._patience = math.ceil(steps / share), round(PATIENCE * steps / share)  # control steps
        self._next_waypoint = 0  # index of the waypoint to meet next
        self._nearest, self._nearest_at = np.inf, 0  # m, smallest distance to it, and after how many control steps
        self._prospect: Prospect | None = None
        self._errors: list[float] = []  # m, distance between measured and predicted achieved goal after each segment
        self._held, self._left = 0, 0  # control steps that the segment was held, and is still to be held
        self._resting = 0  # control steps in which the target is still to come to rest
        self._asked, self._holding = False, False
        self._first_plan_made, self._failed = False, False
        self._path: list[Array] = []  # (3,) m, estimated achieved goal at each step
        self._waited = 0  # control steps of it in which the target held
        self._begun: Array = np.zeros((1, 0))  # estimated state at the start of the segment
        self._applied: list[Array] = []
        self._measured: list[Array] = []  # joint angles after each step since
        self._letting_go: Array | None = None  # (1, J) action of the reflex or of the way back, which replaces the policy's
        self._returning, self._returned_at = False, 0  # and after how many control steps the arm was back
        if adviser.reflex is not None:
            adviser.reflex.reset(target.estimate_state())

    def act(self, observation: Array, latent: Array) -> Array:
        """Return the action of the policy, of reflex or way back where they act instead, or none while the target holds."""
        if self._letting_go is not None:
            return self._letting_go
        if self._holding:
            return np.zeros_like(self._target.applied)
        return self._adviser.act(observation, latent)

    def condition(self, _: int, failed: Array) -> tuple[Array, Array, Array] | None:
        """See `rollout_closed_loop`."""
        if failed[0]:
            self._failed = True
            return None
        seen = self._target.estimate_state()
        self._path.append(seen.achieved_goal[0])
        self._waited += self._holding
        if len(self._path) > 1 and self._letting_go is None:
            self._applied.append(self._target.applied[0].copy())
            self._measured.append(seen.state[0, : self._target.joints])
        self._holding = False
        self._letting_go = self._let_go(seen)
        if self._letting_go is None:
            self._letting_go = self._go_back(seen)
        if self._letting_go is not None:  # no latent is held, and a new plan begins afterwards
            self._prospect, self._asked, self._left, self._resting = None, False, 0, self._settle
            self._applied, self._measured = [], []
            return self._nothing()
        if self._arrived() or self._time_is_up():
            return None
        if self._left == 0:
            if not self._planned(seen):
                self._holding = True
                return self._nothing()
            if len(self._path) > 1 and self._near() and self._hopeless():
                return None
        assert self._prospect is not None
        segment = self._prospect.segment
        latent = segment.latents[min(int(self._held * self._share + 1e-9), segment.steps - 1)]
        self._held, self._left = self._held + 1, self._left - 1
        if self._left == 0:
            self._resting = self._settle
        return latent[None], np.array([segment.skill]), np.array([True])

    def _nothing(self) -> tuple[Array, Array, Array]:
        """Return the condition of a control step in which no latent is held."""
        return np.zeros((1, self._adviser.latent_size)), np.array([-1]), np.array([True])

    def _let_go(self, seen: StateEstimate) -> Array | None:
        reflex = self._adviser.reflex
        return None if reflex is None else reflex.action(seen, self._adviser.sag)

    def _go_back(self, seen: StateEstimate) -> Array | None:
        way_back = self._adviser.way_back
        if way_back is None:
            return None
        if not self._returning:
            since = self._passed - max(self._nearest_at, self._returned_at)
            if since < STUCK * self._steps / len(self._waypoints) or self._near():
                return None
            self._returning = True
            way_back.begin(self._share)
        action = way_back.action(seen, self._adviser.sag)
        if action is None:
            self._returning, self._returned_at = False, self._passed
        return action

    def _planned(self, seen: StateEstimate) -> bool:
        """Plan again; return whether there is a new segment."""
        if not self._asked:
            if self._prospect is not None and self._held >= self._prospect.segment.steps / self._share:
                self._errors.append(float(np.linalg.norm(seen.achieved_goal[0] - self._prospect.place)))
            self._prospect = None
            if self._resting:
                self._resting -= 1
                return False
            waypoints = self._waypoints[self._next_waypoint :]
            told = list(self._applied), list(self._measured)
            self._adviser.ask(Sighting(seen, self._begun, *told, waypoints, self._allowed_gap()))
            self._asked = True
        self._prospect = self._adviser.answer()
        if self._prospect is None:
            return False
        self._asked = False
        self._begun, self._applied, self._measured = seen.state, [], []
        self._held, self._left = 0, math.ceil(self._prospect.segment.steps / self._share)
        if not self._first_plan_made:
            self._left, self._first_plan_made = min(self._left, math.ceil(FIRST_LOOK / self._share)), True
        return True

    @property
    def _passed(self) -> int:
        """Return how many control steps have passed in which the target did not hold."""
        return len(self._path) - 1 - self._waited

    def _time_is_up(self) -> bool:
        """Note how near the waypoint is; return whether all the time has passed, and that of one waypoint without progress."""
        passed = self._passed
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

    def _arrived(self) -> bool:
        """Record a waypoint that is met; return whether the last one is, at a low enough speed."""
        gap = self._gap()
        if self._next_waypoint < len(self._waypoints) - 1:
            met_within = MARGIN * self._target.tolerance
            following = int(
                metrics.next_waypoint(self._next_waypoint, self._path[-1], self._waypoints, met_within, keep_last=True)
            )
            if following > self._next_waypoint:
                # the rest of the segment, and the next one if somebody plans it, are for the previous waypoint
                self._resting = self._settle if self._left else self._resting
                self._next_waypoint, self._left, self._asked = following, 0, False
                self._nearest, self._nearest_at = np.inf, self._passed
            return False
        fastest = self._adviser.final_speed
        slow = not fastest or self._speed() <= fastest
        return gap <= self._allowed_gap() and slow and len(self._path) > 1

    def _allowed_gap(self) -> float:
        """Return the estimated distance from the last waypoint at which the episode may end, m."""
        if self._passed < self._patience:
            return self._adviser.goal_tolerance
        # the skills cannot come closer to some places
        return max(self._adviser.goal_tolerance, MARGIN * self._target.tolerance)

    def _speed(self) -> float:
        """Return the estimated speed of the achieved goal, m/s."""
        behind = self._path[-1 - min(SPEED_WINDOW, len(self._path) - 1)]
        seconds = max(1, min(SPEED_WINDOW, len(self._path) - 1)) * self._target.control_period
        return float(np.linalg.norm(self._path[-1] - behind)) / seconds
