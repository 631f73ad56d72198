"""Holding latents in a world without a simulator: a latent is a velocity, and beyond x = 10 a simulation fails."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from worlds import make_env

from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import SAFETY_LIMITS, Array


class Plane:
    def __init__(self, num_envs: int) -> None:
        self.num_envs, self.position = num_envs, np.zeros((num_envs, 3))

    def observe(self) -> Array:
        return self.position.copy()

    def keypoints(self) -> Array:
        return np.stack([self.position, -self.position], axis=1)

    def step(self, action: Array) -> Any:
        self.position = self.position + action
        return SimpleNamespace(observation=self.observe(), terminated=self.position[:, 0] > 10)

    def set_active(self, ids: Array | None) -> None:
        self.active = ids

    def violations(self) -> Array:
        return np.stack([self.position[:, 1] > 2, self.position[:, 2] > 2], axis=1)

    def save(self, ids: Array) -> Array:
        return self.position[ids]

    def restore(self, ids: Array, sim_states: Array) -> None:
        self.position[ids] = sim_states


def act(observation: Array, latent: Array) -> Array:
    return latent


@pytest.mark.parametrize("slots", [1, 3, 7, 20])
def test_any_number_of_states_is_held_in_any_number_of_slots(slots: int) -> None:
    rng = np.random.default_rng(0)
    sim_states, latent = rng.normal(size=(7, 3)), rng.normal(size=(7, 3))
    world = LatentEnvironment(Plane(slots), act)
    outcome = world.hold(sim_states, latent, 4)
    path = sim_states[:, None] + np.arange(5)[None, :, None] * latent[:, None]
    np.testing.assert_allclose(outcome.path, np.stack([path, -path], axis=2)[:, None])
    np.testing.assert_allclose(outcome.sim_states, path[:, -1])
    assert not outcome.failed.any() and world.control_steps == 7 * 4


@pytest.mark.parametrize("slots", [1, 2, 5])
def test_several_robots_side_by_side_are_each_held_on_its_own(slots: int) -> None:
    rng = np.random.default_rng(0)
    sim_states, latent = rng.normal(size=(5, 2 * 3)), rng.normal(size=(5, 3))
    world = LatentEnvironment(Plane(2 * slots), act, robots=2)
    outcome = world.hold(sim_states, latent, 4)
    for robot in range(2):
        alone = LatentEnvironment(Plane(5), act).hold(sim_states[:, 3 * robot : 3 * robot + 3], latent, 4)
        np.testing.assert_allclose(outcome.path[:, robot], alone.path[:, 0])
        np.testing.assert_allclose(outcome.sim_states[:, 3 * robot : 3 * robot + 3], alone.sim_states)
    assert world.slots == slots and world.control_steps == 5 * 2 * 4 and world.held == 5


def test_a_failure_on_the_way_is_kept_even_if_it_passes() -> None:
    sim_states, latent = np.array([[9.5, 0, 0], [0, 0, 0]]), np.array([[1.0, 0, 0], [1, 0, 0]])
    assert LatentEnvironment(Plane(2), act).hold(sim_states, latent, 3).failed.tolist() == [[True], [False]]


def test_a_limit_that_one_robot_breaks_on_the_way_is_a_failure_where_limits_are_to_be_kept() -> None:
    sim_states = np.array([[0.0, 0, 0, 0, 1.5, 0], [0, 0, 0, 0, 0, 0]])
    latent = np.array([[0.0, 1, 0], [0, 0.2, 0.2]])
    for kept, expected in (
        (SAFETY_LIMITS, [[False, True], [False, False]]),
        (SAFETY_LIMITS[:1], [[False, True], [False, False]]),
        (SAFETY_LIMITS[1:], [[False, False]] * 2),
        ((), [[False, False]] * 2),
    ):
        world = LatentEnvironment(Plane(4), act, robots=2, limits=kept)
        assert world.hold(sim_states, latent, 2).failed.tolist() == expected


def test_the_start_is_where_the_first_slot_stands() -> None:
    plane = Plane(2)
    plane.position[0] = [1, 2, 3]
    row, points = LatentEnvironment(plane, act).start()
    assert row.tolist() == [1, 2, 3] and points.tolist() == [[[1, 2, 3], [-1, -2, -3]]]


@pytest.mark.parametrize("task", [ReachTask(), PushTask()])
def test_holding_on_the_arm_equals_stepping_it_directly(task: ReachTask | PushTask) -> None:
    def joint_policy(observation: Array, latent: Array) -> Array:
        return np.clip(latent + 0.5 * observation[:, :7], -1, 1)

    env, twin = make_env(task, 2, threads=1), make_env(task, 5, threads=1)
    latent = np.random.default_rng(0).uniform(-1, 1, (5, 7))
    sim_states = twin.save(np.arange(5))
    outcome = LatentEnvironment(env, joint_policy).hold(sim_states, latent, 3)
    for t in range(1, 4):
        twin.step(joint_policy(twin.observe(), latent))
        np.testing.assert_array_equal(outcome.path[:, 0, t], twin.keypoints())
    np.testing.assert_array_equal(outcome.sim_states, twin.save(np.arange(5)))
