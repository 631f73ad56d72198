"""Execute the episodes of a schedule on an arm, and record what happens, also when it is stopped on the way."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from skillcli.errors import SkillError
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library
from skillcli.evaluation.rollouts import Act, met, rollout_closed_loop
from skillcli.evaluation.transfer_evaluator import NOMINAL, TransferEvaluator
from skillcli.execution import checks
from skillcli.execution.clock import Ticks, Watchdog, urgent
from skillcli.execution.driver import Driver, DriverError, Resettable
from skillcli.execution.episode_log import EpisodeLog
from skillcli.execution.filter import Limits, SafetyFilter, Stop
from skillcli.execution.home import move_home
from skillcli.execution.loop import Arm, fresh_reading
from skillcli.execution.observed import ObservedArm
from skillcli.execution.planner import PlannerProcess
from skillcli.execution.replanned import moving_steps, play_replanned
from skillcli.simulation.foresight import Foresight
from skillcli.tasks.world import World
from skillcli.trajectories import Array, Trajectories

OnEpisode = Callable[[int, Trajectories | None], None]  # called before each episode, and after it with its recording


@dataclass(frozen=True)
class Asked:
    """What an execution is to be.

    Attributes:
        episodes: how many.
        share: of the largest speed.
        home: whether to move the arm to its start if it is not there.
        dry: whether to do everything but send.
        replan: whether to plan again after every segment, from where the arm is.
    """

    episodes: int = 1
    share: float = 1.0
    home: bool = False
    dry: bool = False
    replan: bool = False


@dataclass
class Execution:
    """What was executed so far."""

    recordings: list[Trajectories] = field(default_factory=list)
    logs: list[EpisodeLog] = field(default_factory=list)
    late: list[float] = field(default_factory=list)  # s, see `Ticks.late`
    missed: int = 0
    stopped: Stop | None = None
    during: bool = False  # whether it was stopped during the last episode, not before the next one
    seconds: float = 0.0  # of the arm's time, since that episode began

    @property
    def episodes(self) -> int:
        """Return how many episodes were begun."""
        return len(self.recordings)


class Executor:
    """Everything that is needed to execute a plan on one arm.

    Args:
        library: the skills.
        world: their task, on the robot file of the arm.
        once: one episode of each route or skill.
        driver: of the arm, connected.
        asked: what to do.
        planner: plans again on the way, if that was asked for.
        seed: of what is random there.

    Raises:
        SkillError: arm, driver or plan are not fit for it; nothing has moved.
    """

    def __init__(
        self, library: Library, world: World, once: EpisodeSchedule, driver: Driver, asked: Asked,
        planner: PlannerProcess | None = None, seed: int = 0,
    ) -> None:  # fmt: skip
        self._planner, self._seed = planner, seed
        self._act, self._driver, self._asked, self._once = library.agent.act, driver, asked, slowed(once, asked.share)
        self._observed = ObservedArm(world)
        self._simulated = driver if isinstance(driver, Resettable) else None
        self.speed = 1.0 if self._simulated is None else self._simulated.speed
        self._patience = 0.0 if self._simulated is None else self._simulated.patience
        self._period = world.task.control_period
        arms, robot = self._observed.env.arms, world.robot
        self.limits = Limits.of(robot, arms, self._period, asked.share)
        self._foresight = Foresight(robot, self._observed.start)
        self.planned = TransferEvaluator(library, 0, world).run(once, NOMINAL)
        checks.check_plan(self.planned)
        state = fresh_reading(driver)
        checks.check_joints(state, robot)
        checks.check_object(driver, self._observed, world.task.name)
        checks.check_range(state, *arms.target_range)
        checks.check_free(self._foresight, state.position)
        self._within = checks.AT_START if self._simulated is None else checks.DRAWN_START
        if not asked.home:
            checks.check_start(state, self._observed.start, self._within)
        self.off = float(np.abs(state.position - self._observed.start).max())  # rad, of the joint farthest from its start

    @property
    def seconds(self) -> float:
        """Return how long the arm moves in the longest episode, s of its time; at most, where it is planned again."""
        steps = float(self._once.steps.max())
        if self._planner is not None:
            steps = max(moving_steps(self._planner, waypoints, self._asked.share) for waypoints in self._once.waypoints)
        return steps * self._period

    def run(self, stop_asked: Callable[[], bool], on_episode: OnEpisode) -> Execution:
        """Execute all episodes; afterwards the arm holds.

        Raises:
            SkillError: the arm cannot be brought to its start before the first episode, or is lost before it.
        """
        done = Execution()
        schedule = self._once.in_turn(self._asked.episodes)
        patience = self._period / self.speed + self._patience
        try:
            with urgent(), unhurried(), Watchdog(self._driver.hold, patience) as watchdog:
                guard = SafetyFilter(self.limits, self._period, self._foresight.touches, self.speed, self._patience)
                arm = Arm(
                    self._driver, self._observed, guard, self._period, watchdog, self.speed, self._asked.share, stop_asked,
                    self._asked.dry,
                )  # fmt: skip
                for episode in range(self._asked.episodes):
                    on_episode(episode, None)
                    if not self._ready(arm, episode, done):
                        break
                    recording = self._play(arm, schedule, episode)
                    watchdog.rest()
                    done.recordings.append(recording)
                    done.logs.append(arm.log)
                    _count(done, arm.ticks)
                    if arm.stopped is not None:
                        done.stopped, done.during = arm.stopped, True
                        done.seconds = max(0.0, (arm.stopped_at - arm.log.tick[0]) * self.speed)
                    on_episode(episode, recording)
                    if arm.stopped is not None:
                        break
        finally:
            self._driver.hold()
        return done

    def _play(self, arm: Arm, schedule: EpisodeSchedule, episode: int) -> Trajectories:
        if self._planner is None:
            return play(arm, self._act, schedule, episode)
        return play_replanned(arm, self._planner, schedule.waypoints[episode], self._seed, self._asked.share)

    def _ready(self, arm: Arm, episode: int, done: Execution) -> bool:
        """Bring the arm to the start of an episode; return whether it is there. Before the first one, raise if it is not."""
        try:
            if self._simulated is not None and episode:
                self._simulated.reset(episode)
            arm.begin()
            off = float(np.abs(arm.position - self._observed.start).max())
            if self._asked.home or (episode > 0 and self._simulated is None):
                if off > checks.AT_START and not self._asked.dry:
                    move_home(arm, self._observed.start, self.limits, self._foresight)
                    arm.ticks.late.clear()
                    if arm.stopped is None:
                        arm.begin()
            elif off > self._within:
                checks.check_start(fresh_reading(self._driver), self._observed.start, self._within)
        except SkillError as error:
            if not done.episodes:
                raise
            reason = "driver_lost" if isinstance(error, DriverError) else "not_at_start"
            done.stopped = Stop(reason, error.message)
            return False
        if arm.stopped is not None:
            if not done.episodes:
                raise DriverError(
                    f"stopped before the first episode, {arm.stopped.reason}: {arm.stopped.message}", "the arm holds"
                )
            done.stopped = arm.stopped
            return False
        return True


def play(arm: Arm, act: Act, schedule: EpisodeSchedule, episode: int) -> Trajectories:
    """Play one episode of a schedule on an arm at its start; it ends early if the arm stops or the task has failed."""
    latent, skill = schedule.latent[episode], schedule.skill[episode]
    waypoints, steps = schedule.waypoints[episode], int(schedule.steps[episode])
    arm.desired_goal[:] = waypoints[-1]

    def condition(t: int, failed: Array) -> tuple[Array, Array, Array] | None:
        if failed[0] or (arm.stopped is not None and t > 0):
            return None
        return latent[t][None], skill[t][None], np.ones(1, dtype=bool)

    recording, _ = rollout_closed_loop(arm, act, condition, steps)
    whole = arm.stopped is None
    return recording.with_success(recording.success & whole & met(recording, [waypoints], arm.tolerance))


def slowed(once: EpisodeSchedule, share: float) -> EpisodeSchedule:
    """Return the schedule for an arm that carries out a share of every action: each latent is held longer in turn."""
    if share == 1.0:
        return once
    steps = np.ceil(once.steps / share).astype(int)
    rows = np.minimum((np.arange(steps.max()) * share + 1e-9).astype(int), once.latent.shape[1] - 1)
    return EpisodeSchedule(once.latent[:, rows], once.skill[:, rows], steps, once.waypoints)


def _count(done: Execution, ticks: Ticks) -> None:
    done.late += ticks.late
    done.missed += ticks.missed()
    ticks.late.clear()


def p99(late: list[float]) -> float:
    """Return the time within which 99 of 100 ticks were answered, s; 0 without ticks."""
    return float(np.quantile(late, 0.99)) if late else 0.0


@contextmanager
def unhurried() -> Iterator[None]:
    """Collect no garbage inside the block: it would come between a tick and its answer."""
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
