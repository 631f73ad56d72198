"""The stored pushes that come with a checkout: nothing overlaps, flies, or moves by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from worlds import model_of, world

from skillcli.recipe import resolve
from skillcli.store import Store
from skillcli.tasks.push.settings import PushTask
from skillcli.trajectories import Array
from studies.contact import penetration, replay

pytestmark = pytest.mark.slow

STORE = Store(Path(__file__).parent.parent / "artifacts")
STORED = [
    "reference-push/pretrain",
    "reference-push/compose",
    "reference-push-robust/pretrain",
    "reference-push-robust/compose",
]
FAR = 0.1  # m from the middle of the box: no finger touches it there, nor can within a control step


def stored(given: str) -> tuple[PushTask, dict[str, Array]]:
    artifact = STORE.read(STORE.resolve(given))
    task = resolve(artifact.recipe).task
    assert isinstance(task, PushTask)
    return task, artifact.group("trajectories")


@pytest.mark.parametrize("given", STORED)
def test_nothing_overlaps_a_box_by_more_than_three_millimetres(given: str) -> None:
    task, recorded = stored(given)
    poses = recorded["joint_position"].reshape(-1, 7), recorded["object_pose"].reshape(-1, 7)
    assert 0 < penetration(model_of(task), *poses) <= 0.003


@pytest.mark.parametrize("given", STORED)
def test_a_box_that_nothing_touches_gains_no_speed(given: str) -> None:
    task, recorded = stored(given)
    box, finger = recorded["object_pose"][..., :3], recorded["gripper_position"]
    speed = np.linalg.norm(np.diff(box, axis=1), axis=2) / task.control_period
    away = np.linalg.norm(box - finger, axis=2) > FAR
    alone = away[:, :-2] & away[:, 1:-1] & away[:, 2:]
    assert alone.any() or "compose" in given, "else this would say nothing; plans end where the finger still is"
    assert (speed[:, 1:] - speed[:, :-1])[alone].max(initial=0.0) < 1e-3
    assert np.isfinite(recorded["object_pose"]).all() and box[..., 2].max() < task.box_size[2]


@pytest.mark.parametrize("given", [given for given in STORED if "pretrain" in given])
def test_half_the_time_step_leads_stored_pushes_to_the_same_places(given: str) -> None:
    task, recorded = stored(given)
    ends = [replay(world(task), recorded["action"], halvings)[-1] for halvings in range(2)]
    assert np.linalg.norm(ends[0] - ends[1], axis=1).max() < 0.005
