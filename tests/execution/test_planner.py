"""The planner beside an arm, in a process of its own: it answers, forgets what is no longer asked, and its end is noticed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from execution.fake_arm import FakeArm

from skillcli.errors import UsageError
from skillcli.evaluation.library import open_library
from skillcli.evaluation.replanned_episode import Prospect, Sighting
from skillcli.execution.clock import Watchdog
from skillcli.execution.filter import Limits, SafetyFilter
from skillcli.execution.loop import Arm
from skillcli.execution.observed import ObservedArm
from skillcli.execution.planner import PlannerLost, PlannerProcess
from skillcli.execution.replanned import play_replanned
from skillcli.store import ArtifactId, Store

pytestmark = pytest.mark.slow  # starts a process that loads a library

STORE = Store(Path(__file__).parents[2] / "artifacts")
PLAN = ArtifactId.parse("reference-reach/compose-v1")
LIBRARY = open_library(STORE, STORE.read(PLAN))
GOAL = np.array([[0.6, 0.2, 0.25]])


@pytest.fixture
def planner() -> Iterator[PlannerProcess]:
    found = PlannerProcess(STORE.root, PLAN, LIBRARY)
    try:
        found.wait()
        yield found
    finally:
        found.close()


def sighting() -> Sighting:
    env = LIBRARY.world.make_env(1, threads=1)
    return Sighting(env.estimate_state(), np.zeros((1, 0)), [], [], GOAL, 0.02)


def answered(planner: PlannerProcess, within: float = 50.0) -> Prospect:
    until = time.monotonic() + within
    while (found := planner.answer()) is None:
        assert time.monotonic() < until
        time.sleep(0.01)
    return found


def test_it_answers_the_last_question_and_its_end_is_noticed(planner: PlannerProcess) -> None:
    assert planner.latent_size == LIBRARY.mean.shape[1] and planner.steps == 200
    assert planner.reflex is None, "nothing can tip"
    planner.begin(0)
    planner.ask(sighting())
    planner.ask(sighting())
    found = answered(planner)
    assert found.segment.steps >= 1 and found.segment.latents.shape[1] == planner.latent_size
    assert 1 <= planner.effort.plans <= 2 and planner.effort.seconds > 0
    assert planner.answer() is None or planner.effort.plans == 2, "every question is answered once"
    planner._process.kill()
    planner.ask(sighting())
    with pytest.raises(PlannerLost, match="ended with code -9"):
        answered(planner)


def test_an_arm_whose_planner_is_gone_holds_and_says_why(planner: PlannerProcess) -> None:
    world = LIBRARY.world
    observed = ObservedArm(world)
    driver = FakeArm(world.robot.description.joints, observed.start)
    driver.connect()
    guard = SafetyFilter(Limits.of(world.robot, observed.env.arms, 0.05), 0.05, lambda _: "")
    killed = SimpleNamespace(at=0)

    def stop_asked() -> bool:
        killed.at += 1
        if killed.at == 3:
            planner._process.kill()
            planner._process.join()
        return False

    with Watchdog(driver.hold, 2.0) as watchdog:
        arm = Arm(driver, observed, guard, 0.05, watchdog, stop_asked=stop_asked)
        arm.begin()
        recording = play_replanned(arm, planner, GOAL, seed=0)
    assert arm.stopped is not None and arm.stopped.reason == "planner_lost" and driver.held
    assert not recording.success[0] and recording.length[0] >= 3
    assert (recording.skill[0, :3] == -1).all() and not recording.action[0, :3].any(), (
        "it held while it waited for the first plan"
    )


def test_a_library_that_is_not_there_is_refused_before_anything_moves(tmp_path: Path) -> None:
    lost = PlannerProcess(tmp_path, PLAN, replace(LIBRARY))
    try:
        with pytest.raises(UsageError):
            lost.wait()
    finally:
        lost.close()
