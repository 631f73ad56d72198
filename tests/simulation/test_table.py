"""A table that is raised and tilted, and boxes of other sizes on it."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import push_env

from skillcli.robots.scene import TABLE_CENTRE
from skillcli.simulation import table
from skillcli.tasks.push.environment import PushEnvironment
from skillcli.tasks.push.settings import PushTask


def test_a_turn_about_y_lowers_what_is_in_front() -> None:
    tilt = np.array([[0.0, 0.1], [0.1, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(
        table.normal(tilt), [[np.sin(0.1), 0, np.cos(0.1)], [0, -np.sin(0.1), np.cos(0.1)], [0, 0, 1]], atol=1e-15
    )
    np.testing.assert_allclose(table.quaternion(tilt)[0], [np.cos(0.05), 0, np.sin(0.05), 0], atol=1e-15)
    place = np.array(TABLE_CENTRE) + np.tile([0.1, 0.2], (3, 1))
    height = table.surface(place, np.array([0.0, 0.0, 0.003]), tilt)
    np.testing.assert_allclose(height, [-0.1 * np.tan(0.1), 0.2 * np.tan(0.1), 0.003], atol=1e-15)


def test_an_orientation_is_turned_in_the_base_frame() -> None:
    quarter = np.sqrt(0.5)
    about_z, about_x = np.array([[quarter, 0, 0, quarter]]), np.array([[quarter, quarter, 0, 0]])
    # x to y by the first, y to z by the second: the other way round x would stay
    np.testing.assert_allclose(table.turned(about_x, about_z), [[0.5, 0.5, -0.5, 0.5]], atol=1e-15)
    np.testing.assert_allclose(table.turned(about_z, about_x), [[0.5, 0.5, 0.5, 0.5]], atol=1e-15)


def environment(num_envs: int, **parameters: list[float] | list[list[float]]) -> PushEnvironment:
    env = push_env(PushTask(), num_envs)
    env.randomize({name: np.array(values) for name, values in parameters.items()}, np.random.default_rng(0))
    env.reset(np.arange(num_envs), np.zeros(num_envs, dtype=np.int64))
    return env


def test_a_box_rests_on_a_tilted_table_until_friction_no_longer_holds_it() -> None:
    """Friction of 0.6 holds up to 31 degrees; a twentieth of that does not hold on 0.15 rad, 8.6 degrees."""
    tilt = [[0.0, 0.0], [0.1, -0.1], [0.0, 0.15]]
    env = environment(3, table_tilt=tilt, contact_friction=[1.0, 1.0, 0.05], table_height=[0.0, 0.01, 0.0])
    before = env.achieved_goal()
    for _ in range(6):
        assert not env.step(np.zeros((3, 7))).terminated.any()
    moved = np.linalg.norm(env.achieved_goal() - before, axis=1)
    assert moved[:2].max() < 2e-3 and moved[2] > 0.02
    assert env.achieved_goal()[2, 0] > before[2, 0], "downhill"


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_box_of_another_size_is_the_one_that_would_have_been_modelled(factor: float) -> None:
    env = environment(2, object_size=[1.0, factor])
    edges = [0.06 * factor] * 3
    other = push_env(PushTask(box_size=(edges[0], edges[1], edges[2])), 1)
    ours, theirs = env.arms.batch.get_model(1), other.arms.model
    for field in ("geom_size", "geom_rbound", "geom_aabb", "body_inertia", "body_mass", "bvh_aabb", "dof_invweight0"):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=1e-9, atol=1e-12, err_msg=field)
    np.testing.assert_allclose(env.arms.object_pose[1], other.arms.object_pose[0])
    np.testing.assert_allclose(env.privileged()[1, :7], other.privileged()[0, :7], atol=1e-6)
    np.testing.assert_array_equal(env.arms.object_pose[0], push_env(PushTask(), 1).arms.object_pose[0])
