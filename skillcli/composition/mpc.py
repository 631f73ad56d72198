"""Model predictive control over latents by the cross-entropy method (Rubinstein 1999; receding horizon: Chua et al. 2018).

Before every segment, sequences of latents are drawn around the best ones so far and tried in the simulator. The first
latent of the best sequence joins the plan; its outcome is already known. Planning continues from there with the rest of
the sequence.
"""

from __future__ import annotations

import numpy as np
from pydantic import model_validator

from skillcli.composition.latent_environment import Outcome
from skillcli.composition.method import MethodSettings, MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.composition.plan import Segment
from skillcli.composition.planner import Proposal
from skillcli.composition.route import Route, RouteProgress, risk_adjusted
from skillcli.config.base import value
from skillcli.seeding import generator
from skillcli.trajectories import Array

MIN_SPREAD = 0.05  # of half the range of latents: keeps the search from collapsing to a point
FAILED = 1e3  # m, cost of a failed simulation


class MpcSettings(MethodSettings):
    """Model predictive control in the latent space: the cross-entropy method, anew for every segment."""

    segment: float = value(0.25, "how long one latent is held, and after which there is replanning", "s", gt=0, le=60)
    lookahead: int = value(2, "segments that are looked ahead", "segments", ge=1, le=100)
    samples: int = value(48, "sequences of latents tried at once", "", ge=2, le=4096)
    elites: int = value(8, "of these, the best ones that the next are drawn around", "", ge=1)
    rounds: int = value(2, "times that sequences are drawn before each segment", "", ge=1, le=100)
    seconds: float = value(5.0, "longest plan, for each waypoint of the route", "s", gt=0, le=600)
    goal_tolerance: float = value(0.02, "the plan ends within this of the last waypoint", "m", gt=0)

    @model_validator(mode="after")
    def _fewer_elites(self) -> MpcSettings:
        if self.elites >= self.samples:
            raise ValueError("elites must be fewer than samples")
        return self


class Lookahead:
    """Sequences of H latents that are being tried from one state, segment by segment."""

    def __init__(self, sequences: Array, sim_state: Array, next_waypoint: Array) -> None:
        count = len(sequences)
        self.sequences = sequences  # (n, H, d)
        self.sim_states = np.tile(sim_state, (count, 1))
        self.next_waypoint = np.tile(next_waypoint, (count, 1))  # (n, M)
        self.cost, self.over = np.zeros(count), np.zeros(count, dtype=bool)
        self.segment = 0  # segments tried so far
        self.first: tuple[Array, Array, RouteProgress] | None = None  # after the first segment: states, keypoints

    def take(self, outcome: Outcome, route: Route, within: float) -> None:
        """Take the outcome of the present segment; a sequence that arrived has no further cost."""
        progress = route.follow(self.next_waypoint, outcome.path, within)
        failed = outcome.failed.any(axis=1)
        self.cost += np.where(self.over, 0.0, progress.cost) + np.where(failed & ~self.over, FAILED, 0.0)
        self.over |= (progress.arrived > 0) | failed
        self.next_waypoint, self.sim_states = (
            progress.next_waypoint,
            np.where(self.over[:, None], self.sim_states, outcome.sim_states),
        )
        if self.first is None:
            self.first = outcome.sim_states, outcome.path, progress
        self.segment += 1


class ModelPredictiveControl:
    """See `Planner`.

    Args:
        sim_state: (S,) the start state.
        keypoints: (M, L, 3) m in that state, on M robots.
        route: waypoints to pass.
        means: (K, d) of the skills; holding each mean is among the first sequences tried before every segment.
        bounds: (2, d) lowest and highest latent.
        settings: from the recipe.
        steps: control steps of one segment.
        longest: most segments in a plan.
        rng: draws the sequences.
    """

    def __init__(
        self, sim_state: Array, keypoints: Array, route: Route, means: Array, bounds: Array, settings: MpcSettings, steps: int,
        longest: int, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._sim_state, self._keypoints, self._next_waypoint = sim_state, keypoints, np.zeros(len(keypoints), dtype=int)
        self._route, self._means, self._settings = route, means, settings
        self._bounds, self._steps, self._longest, self._rng = bounds, steps, longest, rng
        self._half = (bounds[1] - bounds[0]) / 2
        self._mean = np.tile(bounds.mean(axis=0), (settings.lookahead, 1))  # (H, d)
        self._spread = np.tile(self._half, (settings.lookahead, 1))
        self._segments: list[Segment] = []
        self._arrived = (
            len(route.waypoints) == 1 and float(risk_adjusted(route.final_gap(keypoints))) <= settings.goal_tolerance
        )
        self._round = 0
        self._trial = self._draw()

    @property
    def finished(self) -> bool:
        """See `Planner`: the last waypoint is met, or time is up."""
        return self._arrived or len(self._segments) >= self._longest

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        left = float(risk_adjusted(self._route.cost_to_go(self._next_waypoint, self._keypoints)))
        return len(self._segments), self._longest, f"{left:.3f} m to go"

    @property
    def remaining_length(self) -> float:
        """Length of the straight way through the remaining waypoints after the segments so far, m."""
        return float(risk_adjusted(self._route.remaining_length(self._next_waypoint, self._keypoints)))

    @property
    def next_place(self) -> Array:
        """Return the achieved goal after the segments so far, (3,) m, mean over the robots."""
        place: Array = self._keypoints[:, 0].mean(axis=0)
        return place

    def plan(self) -> list[Segment]:
        """See `Planner`."""
        return self._segments

    def ask(self) -> Proposal:
        """See `Planner`: the next segment of all sequences."""
        return Proposal(self._trial.sim_states, self._trial.sequences[:, self._trial.segment], self._steps)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        self._trial.take(outcome, self._route, self._settings.goal_tolerance)
        if self._trial.segment == self._settings.lookahead:
            self._judge()

    def _draw(self, best: Array | None = None) -> Lookahead:
        """Draw new sequences around the mean, from the present state; the first ones hold fixed latents."""
        settings = self._settings
        noise = self._rng.standard_normal((settings.samples, settings.lookahead, len(self._half)))
        drawn = np.clip(self._mean + self._spread * noise, *self._bounds)
        held = np.repeat(self._means[:, None], settings.lookahead, axis=1) if best is None else best[None]
        known = np.concatenate([self._mean[None], held])[: settings.samples]
        drawn[: len(known)] = known
        return Lookahead(drawn, self._sim_state, self._next_waypoint)

    def _judge(self) -> None:
        """End a round: narrow the distribution around the elites, or add the first latent of the best sequence to the plan."""
        sequences = self._trial.sequences
        order = np.argsort(self._trial.cost, kind="stable")
        elites, best = sequences[order[: self._settings.elites]], int(order[0])
        self._mean, self._spread = elites.mean(axis=0), np.maximum(elites.std(axis=0), MIN_SPREAD * self._half)
        self._round += 1
        if self._round < self._settings.rounds:
            self._trial = self._draw(sequences[best])
            return
        self._take(best)
        self._trial = self._draw()

    def _take(self, best: int) -> None:
        """Move to the state after the first latent of this sequence; draw around the rest of it next."""
        assert self._trial.first is not None
        sim_states, path, progress = self._trial.first
        arrived = int(progress.arrived[best])
        steps = arrived or self._steps
        self._sim_state, self._keypoints, self._next_waypoint = (
            sim_states[best],
            path[best, :, steps],
            progress.next_waypoint[best],
        )
        sequence = self._trial.sequences[best]
        self._segments.append(Segment(sequence[0], -1, "latent", steps))
        self._arrived = arrived > 0
        self._mean = np.concatenate([sequence[1:], sequence[-1:]])
        self._spread = np.tile(self._half, (self._settings.lookahead, 1))
        self._round = 0


def mpc_from(
    problem: PlanningProblem, sim_state: Array, keypoints: Array, waypoints: Array, longest: int, rng: np.random.Generator
) -> ModelPredictiveControl:
    """Make a planner from a state (S,) with keypoints (M, L, 3) m to waypoints, for at most some segments."""
    settings = problem.settings_as(MpcSettings)
    route, steps = problem.towards(waypoints), problem.steps(settings.segment)
    return ModelPredictiveControl(sim_state, keypoints, route, problem.mean, problem.bounds, settings, steps, longest, rng)


def plan(problem: PlanningProblem) -> PlanResult:
    """Plan segment by segment until the last waypoint is met or time is up."""
    settings = problem.settings_as(MpcSettings)
    world, longest = problem.make_world(settings.samples), problem.segments(settings.seconds, problem.steps(settings.segment))
    planner = mpc_from(problem, *world.start(), problem.waypoints, longest, generator(problem.seed, "mpc"))
    problem.run(planner, world, "segments")
    segments = planner.plan() or [Segment(problem.mean[0], 0, problem.names[0], 1)]  # already there
    # on a robot, every sequence of every round would begin with the plan so far
    before = np.cumsum([0, *(segment.steps for segment in segments[:-1])]).sum() * settings.samples * settings.rounds
    spent, replayed = world.control_steps * problem.period, float(before) * problem.robots * problem.period
    return PlanResult(segments, world.held, spent, replayed)


METHOD = MethodSpec(
    name="mpc",
    settings=MpcSettings,
    plan=plan,
    hint="look further ahead with --lookahead, or try --set mpc.samples=200",
    options=(Option("lookahead", "Segments that are looked ahead.", "N", int),),
    draws=True,
    ensemble=True,
    on_target=True,
    replans=True,
)
