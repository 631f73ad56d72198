"""Target domains: what is drawn, and what it does to which simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import JOINTS, SAWYER, point_env, push_env, reach_env, width

from skillcli.config.randomization import MAX_LATENCY, PARAMETERS, PER_JOINT, sample
from skillcli.errors import UsageError
from skillcli.simulation.domains import PRESETS, find_domain
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

TASK, PUSH = ReachTask(), PushTask()


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", PRESETS)
def test_parameters_are_drawn_again_the_same_within_their_ranges(name: str) -> None:
    domain = find_domain(name)
    drawn, again = sample(domain.parameters, 200, rng(), JOINTS), sample(domain.parameters, 200, rng(), JOINTS)
    assert drawn.keys() == domain.parameters.keys() <= PARAMETERS.keys()
    for parameter, values in drawn.items():
        np.testing.assert_array_equal(values, again[parameter])
        size = width(parameter)
        assert values.shape == ((200,) if size == 1 else (200, size))
        low, high = min(domain.parameters[parameter].values), max(domain.parameters[parameter].values)
        assert low <= values.min() and values.max() <= high
        assert low == high or np.ptp(values) > 0.5 * (high - low), "the range is used"


def test_an_unknown_domain_names_those_there_are() -> None:
    with pytest.raises(UsageError, match="no domain 'mars'") as caught:
        find_domain("mars")
    assert "real-like" in caught.value.hint


@pytest.mark.parametrize("kind", [reach_env, push_env])
def test_the_nominal_domain_changes_nothing_bit_for_bit(kind: Any) -> None:
    task = TASK if kind is reach_env else PUSH
    plain, nominal = kind(task, 3), kind(task, 3)
    nominal.randomize(sample(find_domain("nominal").parameters, 3, rng(), JOINTS), rng())
    nominal.reset(np.arange(3), np.zeros(3, dtype=np.int64))
    for action in rng().uniform(-1, 1, (8, 3, 7)):
        np.testing.assert_array_equal(plain.step(action).observation, nominal.step(action).observation)


# parameter, model field, which entries of it, how it is changed
FIELDS = [
    ("link_mass", "body_mass", "links", "factor"),
    ("link_mass", "body_inertia", "links", "factor"),
    ("gravity_compensation", "body_gravcomp", "all", "factor"),
    ("joint_damping", "dof_damping", "joints", "factor"),
    ("joint_friction", "dof_frictionloss", "joints", "factor"),
    ("gain", "actuator_gainprm", "joints", "factor"),
    ("gain", "actuator_biasprm", "joints", "factor"),
    ("contact_friction", "geom_friction", "contacts", "factor"),
    ("object_mass", "body_mass", "box", "factor"),
    ("object_mass", "body_inertia", "box", "factor"),
    ("table_height", "geom_pos", "table", "offset"),
    ("latency", "actuator_delay", "joints", "offset"),
]


def entries(model: Any, which: str, field: str) -> Any:
    if which == "links":
        return [model.joint(name).bodyid[0] for name in SAWYER.names.joints]
    if which == "table":
        return (model.geom("table").id, 2)
    if which == "contacts":  # sliding only, not torsion
        touching = ("table", "box", "palm", "rod") if has_box(model) else ("table",)
        return ([model.geom(name).id for name in touching], 0)
    if which == "box":
        return [model.body("box").id]
    return slice(None)


def has_box(model: Any) -> bool:
    return "box" in [model.body(index).name for index in range(model.nbody)]


@pytest.mark.parametrize("kind", [reach_env, push_env])
@pytest.mark.parametrize(("parameter", "field", "which", "how"), FIELDS)
def test_a_parameter_changes_its_field_in_its_own_simulation_only(
    parameter: str, field: str, which: str, how: str, kind: Any
) -> None:
    env = kind(TASK if kind is reach_env else PUSH, 3, delay=True)
    if which == "box" and not has_box(env.arms.model):
        env.randomize({parameter: np.full(3, 1.5)}, rng())  # has no meaning, and does no harm
        return
    neutral, changed = (1.0, 1.5) if how == "factor" else (0.0, 0.02)
    values = np.full((3, 7) if PARAMETERS[parameter].size == PER_JOINT else 3, neutral)
    values[1] = changed
    env.randomize({parameter: values}, rng())
    base = getattr(env.arms.model, field)
    expected = base.copy()
    where = entries(env.arms.model, which, field)
    expected[where] = expected[where] * changed if how == "factor" else expected[where] + changed
    assert not np.array_equal(expected, base)
    for slot, wanted in enumerate([base, expected, base]):
        np.testing.assert_allclose(getattr(env.arms.batch.get_model(slot), field), wanted, rtol=1e-12, err_msg=str(slot))


def reply(latency: float, task: ReachTask = TASK) -> Array:
    """Joint 6 after each of 8 control steps when it is sent off at once, rad."""
    env = reach_env(task, 2, delay=True)
    env.randomize({"latency": np.array([0.0, latency])}, rng())
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    angles = [env.arms.joint_position[:, 6]]
    for _ in range(8):
        env.step(np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1)))
        angles.append(env.arms.joint_position[:, 6])
    return np.stack(angles, axis=1)


@pytest.mark.parametrize(("latency", "late"), [(0.05, 1), (0.1, 2), (0.15, 3)])
def test_latency_delays_the_motion_by_the_stated_time(latency: float, late: int) -> None:
    prompt, delayed = reply(latency)
    np.testing.assert_allclose(delayed[:late], delayed[0], atol=1e-5)
    np.testing.assert_allclose(delayed[late:], prompt[: len(prompt) - late], atol=1e-5)
    assert prompt[-1] - prompt[0] > 0.1


def test_latency_holds_at_a_finer_time_step_too() -> None:
    prompt, delayed = reply(0.1, ReachTask(timestep=0.001))
    np.testing.assert_allclose(delayed[2:], prompt[:-2], atol=1e-5)


def test_an_arm_that_may_be_delayed_but_is_not_moves_as_the_plain_one() -> None:
    plain, prepared = reach_env(TASK, 2), reach_env(TASK, 2, delay=True)
    for action in rng().uniform(-1, 1, (8, 2, 7)):
        np.testing.assert_allclose(plain.step(action).observation, prepared.step(action).observation, atol=1e-6)


def test_commands_are_remembered_for_the_longest_latency_there_may_be() -> None:
    prompt, delayed = reply(MAX_LATENCY)
    np.testing.assert_allclose(delayed[:4], delayed[0], atol=2e-3)
    assert prompt[3] > prompt[0] + 0.05 and delayed[-1] == pytest.approx(prompt[-4], abs=0.01)


def test_a_weaker_compensation_lets_the_arm_sag() -> None:
    env = reach_env(TASK, 2)
    env.randomize({"gravity_compensation": np.array([1.0, 0.8])}, rng())
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    for _ in range(20):
        env.step(np.zeros((2, 7)))
    held, sagging = env.achieved_goal()[:, 2]
    assert held > sagging + 2e-3


def test_the_start_is_offset_in_its_own_simulation() -> None:
    env = reach_env(TASK, 2)
    offset = np.zeros((2, 7))
    offset[1] = 0.02
    env.randomize({"start_offset": offset}, rng())
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    np.testing.assert_allclose(env.arms.joint_position - np.array(SAWYER.start("reach")), offset, atol=1e-12)


def test_sensor_noise_has_its_stated_size_and_leaves_the_robot_alone() -> None:
    env = reach_env(TASK, 400)
    quiet = np.arange(400) < 200
    noise = {"joint_noise": np.where(quiet, 0.0, 0.005), "position_noise": np.where(quiet, 0.0, 0.003)}
    before = env.achieved_goal()
    env.randomize(noise, rng())
    env.reset(np.arange(400), np.zeros(400, dtype=np.int64))
    seen = np.stack([env.observe() for _ in range(10)]).astype(float)
    error = seen - np.concatenate([env.arms.joint_position, env.achieved_goal()], axis=1)
    assert np.abs(error[:, quiet]).max() < 1e-6
    assert error[:, ~quiet, :7].std() == pytest.approx(0.005, rel=0.03)
    assert error[:, ~quiet, 7:].std() == pytest.approx(0.003, rel=0.03)
    assert abs(error[:, ~quiet].mean()) < 1e-4
    np.testing.assert_array_equal(env.achieved_goal(), before)


def test_the_point_knows_gain_and_position_noise() -> None:
    env = point_env(PointTask(), 400)
    gain = np.ones((400, 7))
    gain[200:] = 0.5
    env.randomize({"gain": gain, "position_noise": np.full(400, 0.01), "latency": np.zeros(400)}, rng())
    step = env.step(np.ones((400, 2)))
    np.testing.assert_allclose(env.achieved_goal()[:, 0], np.repeat([0.1, 0.05], 200))
    assert (step.observation - env.achieved_goal()[:, :2]).std() == pytest.approx(0.01, rel=0.1)


def test_a_slippery_table_changes_what_dragging_the_finger_does() -> None:
    paths = []
    for factor in (0.4, 1.4):
        env = reach_env(ReachTask(), 1)
        env.randomize({"contact_friction": np.array([factor])}, np.random.default_rng(0))
        env.reset(np.array([0]), np.array([0]))
        path = []
        for step in range(60):  # down onto the table, then along it
            action = np.zeros((1, 7))
            action[0, 1 if step < 20 else 0] = 1.0
            env.step(action)
            path.append(env.arms.joint_position[0].copy())
        paths.append(np.array(path))
    assert np.abs(paths[0] - paths[1]).max() > 0.01


def test_a_command_that_restarts_is_the_joint_angle_plus_the_increment() -> None:
    env = reach_env(TASK, 4)
    env.randomize({"command_restart": np.array([0.0, 0.5, 1.0, 1.0]), "latency": np.zeros(4)}, rng())
    env.reset(np.arange(4), np.zeros(4, dtype=np.int64))
    action = np.tile([0.5, 0, 0, 0, 0, 0, 1.0], (4, 1))
    for _ in range(5):
        measured, before = env.arms.joint_position.copy(), env.arms.commanded.copy()
        env.step(action)
        lead = before - measured
        expected = measured + 0.04 * action + np.array([1.0, 0.5, 0.0, 0.0])[:, None] * lead
        np.testing.assert_allclose(env.arms.commanded, expected, atol=1e-12)
        np.testing.assert_allclose(env.applied, expected - before, atol=1e-12, err_msg="what is stored adds up to the command")
    went = env.arms.joint_position[:, 6] - env.arms.joint_position[0, 6]
    assert went[2] < went[1] < went[0] == 0 and went[2] == went[3], "it goes a part of the way that was asked for"


def test_a_command_moves_by_its_response_of_the_clipped_increment() -> None:
    env = reach_env(TASK, 2)
    env.randomize({"command_response": np.array([np.ones(7), np.linspace(0.2, 1.4, 7)])}, rng())
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    before = env.arms.commanded.copy()
    env.step(np.full((2, 7), 3.0))
    moved = 0.04 * np.array([np.ones(7), np.linspace(0.2, 1.4, 7)])
    np.testing.assert_allclose(env.arms.commanded - before, moved, atol=1e-12)
    np.testing.assert_allclose(env.applied, moved, atol=1e-12)
