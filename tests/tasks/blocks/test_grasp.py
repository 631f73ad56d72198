"""By script: the physics permits the whole of grasping, lifting, carrying and putting down."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import blocks_env

from skillcli.tasks.blocks.environment import CRUSHED, BlocksEnvironment
from skillcli.tasks.blocks.settings import BlocksTask
from studies.grasp import Outcome, draw, hold, pick_and_place, stack, world

EPISODES = 4
HELD = 2  # the first carry of the default task, which begins with the block in the hand


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    """Blocks at random places and angles, put down at random places."""
    env = world().make_env(EPISODES, 1)
    assert isinstance(env, BlocksEnvironment)
    return pick_and_place(env, *draw(EPISODES))


def test_blocks_are_held_when_they_are_carried_and_do_not_slip(outcome: Outcome) -> None:
    assert outcome.held.all() and (outcome.slip < 1e-3).all()


def test_blocks_lie_where_they_are_put_and_are_let_go(outcome: Outcome) -> None:
    assert outcome.let_go.all() and (outcome.place_error < 2e-3).all()
    np.testing.assert_allclose(outcome.final[:, 2], BlocksTask().block_size / 2, atol=2e-3)


def test_no_block_is_near_to_being_crushed(outcome: Outcome) -> None:
    assert (outcome.force < CRUSHED / 3).all()


@pytest.mark.parametrize("mass", [0.05, 0.3])
def test_a_held_block_slips_less_than_a_millimetre_in_five_seconds(mass: float) -> None:
    env = blocks_env(BlocksTask(start=world().task.start, block_mass=mass), 1, 1)
    env.reset(np.array([0]), np.array([HELD]))
    assert hold(env)[0] < 1e-3 and env.held().all()
    assert np.abs(env.arms.object_velocity).max() < 1e-3


def test_a_block_that_is_too_heavy_for_the_friction_falls() -> None:
    env = blocks_env(BlocksTask(start=world().task.start, block_mass=5.0), 1, 1)  # 49 N on two pads of 20 N each
    env.reset(np.array([0]), np.array([HELD]))
    for _ in range(20):
        env.step(np.array([[0.0] * 7 + [-1.0]]))
    assert not env.held().any()


def test_three_blocks_stand_on_each_other() -> None:
    env = world(others=[[0.4, 0.12], [0.58, -0.13]]).make_env(1, 1)
    assert isinstance(env, BlocksEnvironment)
    tower = stack(env)[0]
    np.testing.assert_allclose(tower[:, 2], [0.02, 0.06, 0.10], atol=4e-3)
    assert np.linalg.norm(tower[:, :2] - tower[0, :2], axis=1).max() < 3e-3
    for _ in range(40):
        env.step(np.array([[0.0] * 8]))
    np.testing.assert_allclose(env.arms.object_poses.reshape(3, 7)[:, :3], tower, atol=1e-3)


@pytest.mark.slow
def test_half_the_time_step_leads_to_the_same_places() -> None:
    ends = []
    for timestep in (0.0025, 0.00125):
        env = world(timestep=timestep).make_env(EPISODES, 1)
        assert isinstance(env, BlocksEnvironment)
        ends.append(pick_and_place(env, *draw(EPISODES)).final)
    assert np.linalg.norm(ends[0] - ends[1], axis=1).max() < 1e-3
