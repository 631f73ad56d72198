"""Stage 3 on an arm: execute a composition, or bare skills, through a driver, in real time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from skillcli import metrics
from skillcli.errors import Interrupted, UsageError
from skillcli.evaluation.consistency import stored_recipe
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.replanning import method_of
from skillcli.evaluation.transfer_results import count_violations, outcome
from skillcli.execution.drivers import open_driver
from skillcli.execution.episode_log import log_arrays
from skillcli.execution.execute import Asked, Execution, Executor, p99
from skillcli.execution.filter import LIMITED
from skillcli.execution.planner import PlannerProcess
from skillcli.kinds import EXECUTION
from skillcli.kinds.execution import Deadlines, ExecutedArm, ExecutionMeasured, ExecutionResults, Stopped
from skillcli.progress import OnProgress, Progress, silent
from skillcli.recipe import Recipe
from skillcli.robots.robot import Robot
from skillcli.simulation.domains import find_domain
from skillcli.stopping import stoppable
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.tasks.world import World
from skillcli.trajectories import Trajectories

SIMULATION = "simulation"
Confirm = Callable[[Sequence[str]], bool]  # shows what will happen, and returns whether it shall


@dataclass(frozen=True)
class Via:
    """The arm, and how it is reached.

    Attributes:
        driver: by name.
        settings: its own.
        robot: the arm, if it is not that of the skills.
    """

    driver: str = SIMULATION
    settings: Mapping[str, object] = field(default_factory=dict)
    robot: Robot | None = None


def execute(
    store: Store,
    source_id: ArtifactId,
    via: Via,
    asked: Asked,
    confirm: Confirm,
    command: str,
    name: str | None = None,
    seed: int = 0,
    on_progress: OnProgress = silent,
) -> Artifact:
    """Execute in real time and write an execution artifact, also when it was stopped on the way.

    Args:
        store: to read from and write to.
        source_id: a compose artifact, or embed-means or pretrain for bare skills.
        via: the arm.
        asked: how many episodes, how fast.
        confirm: asked before anything moves.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        seed: of simulated robots.
        on_progress: called before and after each episode.

    Raises:
        UsageError: driver, settings or task do not fit.
        DriverError: the arm does not answer, its joints are others, or it stopped before the first episode.
        SkillError: arm or plan are not fit for it; nothing has moved.
        Interrupted: it was not confirmed.
        StoreError: the source cannot be read, or the store refuses.
    """
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library, recipe = open_library(store, source), stored_recipe(source)
    if not library.world.spec.uses_robot:
        raise UsageError(
            f"the {recipe.task.name} task has no arm to execute it", "give a plan of a task on an arm, such as reach"
        )
    if library.world.spec.grasps:
        raise UsageError(
            f"the {recipe.task.name} task moves the fingers of a hand, and drivers command the joints of an arm only",
            "in the simulation: skill transfer-eval",
        )
    world = library.world if via.robot is None else library.world.on(via.robot)
    if asked.replan and asked.dry:
        raise UsageError(
            "a dry run sends nothing: the arm would stand at its start whenever it is planned again",
            "leave out --dry-run, or --replan",
        )
    if asked.replan:
        method_of(source)  # refuses what cannot be planned again
    once = EpisodeSchedule.of(source, library)
    settings = _settings(via, library.recipe, seed)
    driver = open_driver(via.driver, settings, world.robot)
    with ExitStack() as ending:
        planner = None
        if asked.replan:
            planner = PlannerProcess(store.root, source.id, library)
            ending.callback(planner.close)
        ending.callback(driver.close)
        driver.connect()
        executor = Executor(library, world, once, driver, asked, planner, seed)
        if planner is not None:
            planner.wait()
        if not asked.dry and not confirm(_announced(source, via, world, executor, asked)):
            raise Interrupted("not confirmed: nothing was sent", "--yes answers yes")
        with stoppable() as stop:
            done = executor.run(lambda: stop.requested, _Told(asked.episodes, on_progress))
    effort = None if planner is None else planner.effort.mean
    return store.write(_draft(source, recipe, library, world, via, asked, done, command, name, seed, once, effort))


def _settings(via: Via, recipe: Recipe, seed: int) -> dict[str, object]:
    """Return the driver's settings; a simulated arm also needs the task."""
    own = {"recipe": recipe.model_dump(mode="json"), "seed": seed} if via.driver == SIMULATION else {}
    if clash := sorted(own.keys() & via.settings.keys()):
        raise UsageError(f"the driver's settings hold {', '.join(clash)}, which the command says", "leave them out there")
    return {**own, **via.settings}


def _announced(source: Artifact, via: Via, world: World, executor: Executor, asked: Asked) -> list[str]:
    """Say what will happen, in some lines."""
    planned = executor.planned
    gap = 100 * metrics.final_distance(planned).max()
    assert planned.joint_position is not None, "an arm"
    fastest = np.abs(np.diff(planned.joint_position, axis=1)).max() / world.task.control_period * asked.share
    lasts = f" of {executor.seconds:.1f} s at most"
    if asked.replan:
        lasts = f"; the arm moves for {executor.seconds:.0f} s at most in each, and holds while it plans again"
    return [
        f"{source.id} on {world.robot.name}, by the driver {via.driver}: {asked.episodes} "
        f"episode{'s' if asked.episodes > 1 else ''}{lasts}",
        f"in our simulation the plan keeps every limit, ends {gap:.1f} cm from its goals, and moves no joint faster than "
        f"{fastest:.2f} rad/s",
        f"the arm is {executor.off:.3f} rad from the start" + (": it moves there first, slowly" if asked.home else ""),
        "Ctrl-C stops: the arm holds",
    ]


class _Told:
    """Passes on progress."""

    def __init__(self, total: int, on_progress: OnProgress) -> None:
        self._total, self._on_progress, self._successes = total, on_progress, list[bool]()

    def __call__(self, episode: int, recording: Trajectories | None) -> None:
        if recording is not None:
            self._successes.append(bool(recording.success[0]))
        rate = {"arm": float(np.mean(self._successes))} if self._successes else {}
        self._on_progress(Progress(EXECUTION.name, len(self._successes), self._total, "episodes", success=rate))


def _draft(
    source: Artifact, recipe: Recipe, library: Library, world: World, via: Via, asked: Asked, done: Execution,
    command: str, name: str | None, seed: int, once: EpisodeSchedule, seconds_per_plan: float | None,
) -> Draft:  # fmt: skip
    recording = Trajectories.join(done.recordings)
    limited = [np.array(log.limited).reshape(-1, len(LIMITED)) for log in done.logs]
    filtered = {limit: int(sum(steps[:, column].sum() for steps in limited)) for column, limit in enumerate(LIMITED)}
    domain = str(via.settings.get("domain", "nominal")) if via.driver == SIMULATION else None
    results = ExecutionResults(
        **vars(outcome(recording, repeats=False)),
        driver=via.driver,
        robot=ExecutedArm(name=world.robot.name, fingerprint=world.robot.fingerprint),
        domain=None if domain is None else find_domain(domain).name,
        max_speed=asked.share,
        dry_run=asked.dry,
        replanned=asked.replan,
        filtered_steps=int(sum(steps.any(axis=1).sum() for steps in limited)),
        filtered={limit: count for limit, count in filtered.items() if count},
        violations=count_violations(recording),
        stopped=_stopped(done),
    )
    measured = ExecutionMeasured(
        deadlines=Deadlines(steps=len(done.late), missed=done.missed, p99_ms=1000 * p99(done.late)),
        robot_file=None if via.robot is None else via.robot.which,
        seconds_per_plan=seconds_per_plan,
    )
    zero = done.logs[0].tick[0]
    return Draft(
        kind=EXECUTION.name,
        name=name or source.id.name,
        seed=seed,
        command=command,
        recipe=recipe.model_dump(mode="json"),
        arrays={
            **log_arrays(done.logs, zero),
            "episodes/route": np.arange(done.episodes) % once.episodes,
            "episodes/final_distance": metrics.final_distance(recording),
            **recording.stored(),
        },
        results=results.json(),
        measured=measured.json(),
        parents=[source.id],
        model_sha256=library.world.fingerprint,
    )


def _stopped(done: Execution) -> Stopped | None:
    if done.stopped is None:
        return None
    return Stopped(
        reason=done.stopped.reason,
        message=done.stopped.message,
        episode=done.episodes - (1 if done.during else 0),
        seconds=done.seconds,
    )
