"""A planner in a process of its own: planning takes longer than a control step, and must not delay one."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from skillcli.errors import SkillError, UsageError
from skillcli.evaluation.consistency import stored_recipe
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.replanned_episode import Prospect, Sighting
from skillcli.evaluation.replanning import Effort, Replanner, method_of, reflex_of, way_back_of
from skillcli.stopping import answered
from skillcli.store import ArtifactId, Store
from skillcli.trajectories import Array

START_SECONDS = 120.0  # s, within which the process must have opened the library
LONGEST_THOUGHT = 60.0  # s, that a plan may take while the arm holds
END_SECONDS = 2.0  # s, that the process may take to end
MOST_TOLD = 200  # control steps of a segment: a pipe takes 64 kB at once, and who sends more waits for the other process
YIELDS = 2  # niceness: the loop of the arm, and a simulated arm, come first


class PlannerLost(SkillError):
    """The process of the planner ended, or does not answer."""


@dataclass(frozen=True)
class _Ready:
    latent_size: int
    goal_tolerance: float
    final_speed: float
    steps: int


@dataclass(frozen=True)
class _Begin:
    seed: int


@dataclass(frozen=True)
class _Question:
    number: int
    sighting: Sighting


@dataclass(frozen=True)
class _Answer:
    number: int
    prospect: Prospect
    sag: Array
    effort: Effort


@dataclass(frozen=True)
class _Trouble:
    message: str
    hint: str


class PlannerProcess:
    """An `Adviser` whose answers come some control steps later.

    Args:
        store: folder of the store.
        source: a composition whose plan can be made again, see `method_of`; its recipe says how.
        library: its skills: policy and reflex act here, in every control step.
    """

    def __init__(self, store: Path, source: ArtifactId, library: Library) -> None:
        self.act, self.effort = library.agent.act, Effort()
        env = library.world.make_env(1, threads=1)
        self.reflex, self.way_back = reflex_of(env), way_back_of(env)
        self.sag: Array = np.zeros(library.world.joints)
        self._number, self._asked_at = 0, 0.0
        self._ready: _Ready | None = None
        context = get_context("spawn")  # a fork would share the threads of torch
        self._end, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, store, source), name="planner", daemon=True)
        with answered(signal.SIG_IGN):  # a Ctrl-C in the terminal is for us, who then hold the arm
            self._process.start()
        theirs.close()

    def wait(self) -> None:
        """Wait until it can plan.

        Raises:
            SkillError: it cannot.
        """
        if not self._end.poll(START_SECONDS):
            raise PlannerLost(f"the planner did not begin within {START_SECONDS:g} s", "is the machine very busy?")
        told = self._receive()
        assert isinstance(told, _Ready)
        self._ready = told

    @property
    def latent_size(self) -> int:
        """See `Adviser`."""
        return self._known.latent_size

    @property
    def goal_tolerance(self) -> float:
        """See `Adviser`."""
        return self._known.goal_tolerance

    @property
    def final_speed(self) -> float:
        """See `Adviser`."""
        return self._known.final_speed

    @property
    def steps(self) -> int:
        """Return how many control steps an episode has for each waypoint."""
        return self._known.steps

    def begin(self, seed: int) -> None:
        """Begin an episode, of which nothing is known."""
        self.sag = np.zeros_like(self.sag)
        self._number += 1
        self._send(_Begin(seed))

    def ask(self, sighting: Sighting) -> None:
        """See `Adviser`."""
        self._number += 1
        self._asked_at = time.monotonic()
        if len(sighting.applied) > MOST_TOLD:
            sighting = replace(sighting, applied=[], measured=[])
        self._send(_Question(self._number, sighting))

    def answer(self) -> Prospect | None:
        """See `Adviser`.

        Raises:
            PlannerLost: there will be none.
        """
        while self._end.poll():
            told = self._receive()
            assert isinstance(told, _Answer)
            self.effort = told.effort
            if told.number == self._number:
                self.sag = told.sag
                return told.prospect
        if time.monotonic() - self._asked_at > LONGEST_THOUGHT:
            raise PlannerLost(f"the planner found no plan within {LONGEST_THOUGHT:g} s", "is the machine very busy?")
        return None

    def close(self) -> None:
        """End the process; may be called twice."""
        self._end.close()  # an idle process ends then
        self._process.join(END_SECONDS if self._ready else 0.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    @property
    def _known(self) -> _Ready:
        assert self._ready is not None, "wait first"
        return self._ready

    def _send(self, message: _Begin | _Question) -> None:
        with suppress(OSError):  # `answer` says why
            self._end.send(message)

    def _receive(self) -> _Ready | _Answer:
        try:
            told: _Ready | _Answer | _Trouble = self._end.recv()
        except (EOFError, OSError):
            self._process.join(END_SECONDS)
            raise PlannerLost(f"the planner's process ended with code {self._process.exitcode}", "start again") from None
        if isinstance(told, _Trouble):
            raise UsageError(told.message, told.hint)
        return told


def _serve(end: Connection, folder: Path, source: ArtifactId) -> None:
    """Plan until the other end closes."""
    os.nice(YIELDS)
    try:
        try:
            store = Store(folder)
            plan = store.read(source)
            replanner = Replanner(open_library(store, plan), stored_recipe(plan), method_of(plan))
        except SkillError as error:
            end.send(_Trouble(error.message, error.hint))
            return
        steps = replanner.problem.steps(replanner.recipe.transfer.replan_seconds)
        end.send(_Ready(replanner.latent_size, replanner.goal_tolerance, replanner.final_speed, steps))
        while True:
            told = end.recv()
            if isinstance(told, _Begin):
                replanner.begin(told.seed)
                continue
            if end.poll():  # nobody waits for this answer any more, but what was seen still counts
                replanner.update(told.sighting.begun, told.sighting.applied, told.sighting.measured)
                continue
            replanner.ask(told.sighting)
            prospect = replanner.answer()
            assert prospect is not None, "it answers at once"
            end.send(_Answer(told.number, prospect, replanner.sag, replanner.effort))
    except (EOFError, OSError):
        return  # the other end has closed
