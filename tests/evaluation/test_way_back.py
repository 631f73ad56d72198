"""The way back to the start: up first, and then every joint, from anywhere beside, on or over the box."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_replanned_episode import Slow, played, runs
from worlds import blocks_env, make_env, push_env

from skillcli.evaluation.replanning import way_back_of
from skillcli.evaluation.way_back import WayBack
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask

BESIDE = np.array([0.6, -0.08, 0.02])  # m, low and left of the box


@pytest.mark.parametrize("sag", [np.zeros(7), np.array([0, 0.02, 0, 0.01, 0, 0, 0])], ids=["carried", "sagging"])
def test_a_finger_beside_the_box_rises_before_it_goes_sideways_and_ends_at_its_start(sag: np.ndarray) -> None:
    env, way_back = push_env(PushTask(), 1), WayBack(push_env(PushTask(), 1))
    start, limit = env.arms.commanded[0].copy(), PushTask().action_limit
    for target in ([0.65, -0.15, 0.14], [0.6, -0.15, 0.05], BESIDE):
        for _ in range(12):
            env.step(np.clip(env.arms.turns_towards((target - env.arms.gripper_position[0])[None]) / limit, -1, 1))
    assert env.arms.gripper_position[0, 2] < 0.05
    box = env.arms.object_pose[0, :3].copy()
    way_back.begin()
    path = []
    while (action := way_back.action(env.estimate_state(), sag)) is not None:
        assert action.shape == (1, 7) and np.abs(action).max() <= 1
        env.step(action)
        path.append(env.arms.gripper_position[0].copy())
    assert len(path) < 60 and np.abs(env.arms.commanded[0] - start).max() <= 0.02
    sideways, height = np.linalg.norm((np.array(path) - BESIDE)[:, :2], axis=1), np.array(path)[:, 2]
    assert (height[sideways > 0.05] > 0.08).all(), "first up"
    np.testing.assert_allclose(env.arms.object_pose[0, :3], box, atol=1e-3)


def test_an_arm_that_does_not_get_back_is_left_to_the_next_plan() -> None:
    env, way_back = push_env(PushTask(), 1), WayBack(push_env(PushTask(), 1))
    for _ in range(5):
        env.step(np.full((1, 7), 0.5))
    for share, steps in ((1.0, 60), (0.5, 120)):
        way_back.begin(share)
        seen = env.estimate_state()  # it never moves
        assert [way_back.action(seen, np.zeros(7)) is not None for _ in range(steps + 1)] == [True] * steps + [False]


def test_only_arms_that_push_go_back() -> None:
    assert way_back_of(push_env(PushTask(), 1)) is not None
    assert way_back_of(make_env(ReachTask(), 1, 1)) is None
    assert way_back_of(blocks_env(BlocksTask(grasped_starts=False), 1, 1)) is None, "it may hold a block"


def going_back(lasts: int) -> tuple[Slow, list[str]]:
    """An adviser whose way back takes some control steps, and what it was told."""
    adviser, told = Slow(takes=0), list[str]()
    left = [0]

    def begin(share: float) -> None:
        told.append("begin")
        left[0] = lasts

    def action(seen: object, sag: object) -> np.ndarray | None:
        left[0] -= 1
        return np.zeros((1, 7)) if left[0] >= 0 else None

    adviser.way_back = SimpleNamespace(begin=begin, action=action)  # type: ignore[assignment]
    return adviser, told


def test_an_episode_that_comes_no_nearer_for_half_of_its_time_begins_anew() -> None:
    adviser, told = going_back(lasts=5)
    recording, mission = played(adviser, steps=40)
    assert runs(recording.skill[0]) == [(0, 20), (-1, 5), (0, 15)]
    assert told == ["begin"] and mission.gave_up()


@pytest.mark.parametrize(("side", "anew"), [(0.3, 0), (-0.3, 1)], ids=["nearer", "farther"])
def test_an_episode_that_comes_nearer_does_not(side: float, anew: int) -> None:
    here = make_env(ReachTask(), 1, 1).achieved_goal()  # the first joint turns to the left
    adviser, told = going_back(lasts=5)
    played(adviser, steps=40, most=28, waypoints=here + np.array([[0.0, side, 0.0]]))
    assert len(told) == anew
