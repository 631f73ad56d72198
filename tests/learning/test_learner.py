"""Training as a whole, on a point recipe of milliseconds."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import torch
from worlds import SAWYER, make_env

from skillcli.learning import gaussian, te_ppo
from skillcli.learning.agent import windows
from skillcli.learning.learner import Learner
from skillcli.learning.rollout import WAY_SIZE, StartPool, collect, privileged, start_episodes
from skillcli.learning.saved import curve_names
from skillcli.recipe import Recipe, load_recipe, resolve
from skillcli.simulation.environment import Step
from skillcli.tasks.point.environment import PointEnvironment
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.world import skill_goals
from skillcli.trajectories import Array

pytestmark = pytest.mark.slow

Tamper = Callable[[dict[str, Array], dict[str, Any]], Any]

RECIPE = load_recipe(
    "point",
    ["training.iterations=6", "training.simulations=8", "training.minibatch=20", "training.epochs=3", "task.horizon=10"],
)


RANDOMISED = resolve(
    RECIPE.model_dump(mode="json"),
    ["randomisation.dynamics.gain={uniform=[0.5, 1.5]}", "randomisation.sensing.position_noise=0.01"],
)


# The same on the arm: a box, robots that differ, delayed and noisy, and what only the value function sees.
PUSHED = load_recipe(
    "push-robust",
    ["training.iterations=6", "training.minibatch=20", "training.epochs=3", "training.chained_starts=0.5", "task.horizon=10"],
)

REPEATING = resolve(RECIPE.model_dump(mode="json"), ["training.repeat_worst=0.2", "mixtures.share=0.4"])


def learner(seed: int = 0, num_envs: int = 8, recipe: Recipe = RECIPE) -> Learner:
    return Learner(make_env(recipe.task, num_envs, delay="latency" in recipe.randomisation.ranges), recipe, seed)


def run(trained: Learner, iterations: int) -> Learner:
    for _ in range(iterations):
        trained.iterate()
    return trained


def same(first: Learner, second: Learner) -> bool:
    weights, others = first.agent.arrays(), second.agent.arrays()
    curves = first.curves == second.curves
    return curves and all(np.array_equal(weights[name], others[name]) for name in weights)


def test_the_same_seed_trains_the_same_weights_bit_for_bit() -> None:
    first, again, other = run(learner(), 3), run(learner(), 3), run(learner(seed=1), 3)
    assert same(first, again) and not same(first, other)


@pytest.mark.parametrize("recipe", [RECIPE, RANDOMISED, PUSHED, REPEATING], ids=["plain", "randomised", "pushed", "repeating"])
def test_training_goes_on_from_a_saved_state_bit_for_bit(recipe: Recipe) -> None:
    whole = run(learner(recipe=recipe), 6)
    half = run(learner(recipe=recipe), 3)
    arrays, state = half.state()
    arrays = {path: array.copy() for path, array in arrays.items()}
    run(half, 1)  # must not reach into what was saved
    resumed = run(learner(recipe=recipe), 1)  # somewhere else
    resumed.load(arrays, state)
    assert resumed.iteration == 3 and not resumed.finished
    assert same(run(resumed, 3), whole) and resumed.finished
    assert resumed.env_steps == whole.env_steps == 6 * 8 * 10


def _put(path: str, value: Any) -> Tamper:
    """Another value at a dotted path of the state."""

    def tamper(_: dict[str, Array], state: dict[str, Any]) -> None:
        *outer, last = path.split(".")
        for key in outer:
            state = state[key]
        state[last] = value

    return tamper


def _array(path: str, change: Callable[[Array], Array]) -> Tamper:
    def tamper(arrays: dict[str, Array], _: dict[str, Any]) -> None:
        arrays[path] = change(arrays[path])

    return tamper


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (_put("iteration", 10**9), "iteration must be between 1 and 6, got 1000000000"),
        (_put("iteration", -5), "got -5"),
        (_put("iteration", 0), "got 0"),
        (_put("iteration", 2), "env_steps must be 160, got 240"),
        (_put("iteration", True), "got True"),
        (_put("iteration", "3"), "got '3'"),
        (_put("env_steps", 240.0), "env_steps must be 240, got 240.0"),
        (lambda _, state: state.pop("pool"), "its state lacks or should not have"),
        (_put("more", 1), "its state lacks or should not have"),
        (_put("sampling_seconds", -1.0), "sampling_seconds must be a duration"),
        (_put("sampling_seconds", "0"), "sampling_seconds must be a duration"),
        (_put("policy_rate", 0.5), "policy_rate must be between"),
        (_put("policy_rate", 0.001), "policy_rate is not where its curve ends"),
        (_put("pool", [3]), "pool must be two whole numbers"),
        (_put("pool", [5000, 0]), "pool cannot have 5000 states"),
        (_put("pool", [90, 3]), "pool cannot have 90 states"),
        (_put("generator", "garbage"), "generator is not the state of one"),
        (_put("generator.state.state", 2**128), "generator is not the state of one"),
        (_put("generator.state", [1, 2]), "generator is not the state of one"),
        (_put("generator.state.inc", 1), "generator is that of another seed"),
        (_put("generator.bit_generator", "MT19937"), "generator is that of another seed"),
        (_array("agent/policy.body.0.weight", lambda array: array[:-1]), "holds float32 of shape"),
        (_array("agent/policy.log_std", lambda array: array.astype(float)), "holds float64"),
        (_array("agent/policy.log_std", lambda array: array * np.float32("nan")), "not finite"),
        (_array("agent/normalizer.variance", lambda array: -array - 1), "agent/normalizer.variance is negative"),
        (_array("optimizer/value/0/exp_avg_sq", lambda array: array - 1), "optimizer/value/0/exp_avg_sq is negative"),
        (lambda arrays, _: arrays.pop("optimizer/value/0/exp_avg"), "optimizer/value/0/exp_avg is missing"),
        (lambda arrays, _: arrays.pop("curves/kl"), "curves/kl is missing"),
        (lambda arrays, _: arrays.update({"curves/more": arrays["curves/kl"]}), "curves/more is not part of it"),
        (_array("curves/return", lambda array: array[:-1]), "curves/return holds float64 of shape"),
        (_array("curves/env_steps", lambda array: array + 1), "curves/env_steps does not count"),
        (_array("pool", lambda array: array[:, :-1]), "pool holds float64 of shape"),
        (_array("pool", lambda array: array + np.inf), "pool holds values that are not finite"),
        (lambda arrays, _: arrays.pop("pool"), "pool is missing"),
    ],
)
def test_a_state_that_no_training_was_in_is_refused_and_changes_nothing(tamper: Tamper, told: str) -> None:
    saved, fresh = run(learner(), 3), run(learner(), 1)
    arrays, state = saved.state()
    tamper(arrays, state)
    with pytest.raises(ValueError, match=re.escape(told)):
        fresh.load(arrays, state)
    assert fresh.iteration == 1 and same(fresh, run(learner(), 1))


def test_the_state_of_another_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="generator is that of another seed"):
        learner(seed=1).load(*run(learner(), 3).state())


def test_every_curve_has_a_name_that_a_saved_state_must_have() -> None:
    assert run(learner(), 1).curves.keys() == curve_names(4, ["distance"])


def test_exploration_that_comes_down_is_not_the_policys_own_change() -> None:
    """Else every update at the end would be too large for the target KL, and the step size would sink to nothing."""
    recipe = resolve(RECIPE.model_dump(mode="json"), ["training.final_action_std=0.03", "training.settle_from=0.0"])
    trained = learner(recipe=recipe)
    trained.iteration = 5  # of 6: from a standard deviation of 0.6 to one of 0.05 at once
    trained.optimizers.policy_rate = 1e-5
    run(trained, 1)
    assert trained.curves["action_std"][-1] == pytest.approx(0.03 ** (5 / 6), rel=1e-3)
    assert 0 <= trained.curves["kl"][-1] < 1e-3


def test_a_point_learns_its_skills() -> None:
    recipe = load_recipe("point", ["training.chained_starts=0"])
    trained = run(Learner(make_env(recipe.task, 32), recipe, 0), 15)
    regret = -np.array(trained.curves["return"])
    assert regret[-3:].mean() < 0.8 * regret[:3].mean()


def test_every_iteration_gives_one_point_on_every_curve() -> None:
    trained = run(learner(), 2)
    assert {"return", "success_rate", "final_distance", "kl", "inference_log_prob", "value_loss", "success/4"} <= set(
        trained.curves
    )
    assert {len(curve) for curve in trained.curves.values()} == {2}
    assert trained.curves["env_steps"] == [80, 160]


def test_the_embedding_learns_through_the_policy() -> None:
    trained = learner()
    rollout = collect(trained.env, trained.agent, trained.pool, 0.0, trained.rng)
    batch, _ = te_ppo.prepare(rollout, trained.agent, RECIPE.training)
    training = RECIPE.training.model_copy(update={"embedding_entropy": 0.0, "policy_entropy": 0.0})
    te_ppo.update(batch, trained.agent, trained.optimizers, training, 0.0, trained.rng)
    for weight in (trained.agent.embedding.raw_mean, trained.agent.embedding.raw_std):
        assert weight.grad is not None and (weight.grad.abs().sum(1) > 0).all(), "every skill"


def test_fixed_means_stay_where_they_started_while_the_rest_learns() -> None:
    recipe = resolve(RECIPE.model_dump(mode="json"), ["embedding.fixed_means=true"])
    trained = learner(recipe=recipe)
    mean, std = trained.agent.embed()
    weights = trained.agent.arrays()
    run(trained, 2)
    np.testing.assert_array_equal(trained.agent.embed()[0], mean)
    assert (trained.agent.embed()[1] != std).all()
    assert all((trained.agent.arrays()[name] != weights[name]).any() for name in weights if "body" in name)
    resumed = run(learner(recipe=recipe), 1)  # somewhere else
    resumed.load(*trained.state())
    assert same(run(resumed, 1), run(trained, 1))


def test_a_batch_is_the_rollout_without_what_lies_behind_a_failure() -> None:
    trained = learner()
    trained.iterate()
    rollout = collect(trained.env, trained.agent, trained.pool, 0.5, trained.rng)
    valid = rollout.valid.copy()
    valid[4:, 2] = False
    batch, logged = te_ppo.prepare(replace(rollout, valid=valid), trained.agent, RECIPE.training)
    count = 8 * 10 - 6
    assert {len(getattr(batch, field.name)) for field in fields(batch)} == {count}
    assert float(batch.advantage.mean()) == pytest.approx(0, abs=1e-5) and float(batch.advantage.std()) == pytest.approx(
        1, abs=1e-4
    )
    np.testing.assert_allclose(batch.action, rollout.action[valid])
    normalized = trained.agent.normalizer(torch.from_numpy(rollout.observation))
    expected = windows(normalized, trained.agent.window)[1:][torch.from_numpy(valid)]
    np.testing.assert_array_equal(batch.window, expected)
    assert set(logged) == {"inference_log_prob", "explained_variance"}


def test_one_latent_per_episode_and_its_noise_is_kept() -> None:
    trained = learner()
    rollout = collect(trained.env, trained.agent, trained.pool, 0.0, trained.rng)
    mean, std = trained.agent.embed()
    np.testing.assert_allclose(rollout.latent, mean[rollout.skill] + std[rollout.skill] * rollout.noise, rtol=1e-5)
    assert sorted(rollout.skill.tolist()) == [0, 0, 1, 1, 2, 2, 3, 3]
    assert rollout.observation.shape == (11, 8, 2) and rollout.valid.all() and not rollout.terminated.any()
    np.testing.assert_allclose(rollout.observation[0], 0, err_msg="without chained starts all begin at the start")


class Breaking(PointEnvironment):
    """Simulation 1 fails in every third step."""

    taken = 0

    def step(self, action: Array) -> Step:
        step, self.taken = super().step(action), self.taken + 1
        step.terminated[1] = self.taken % 10 == 3
        return step


def test_the_log_density_of_an_action_is_that_of_the_policy_that_drew_it() -> None:
    trained = run(learner(), 2)
    agent = trained.agent
    rollout = collect(trained.env, agent, trained.pool, 0.5, trained.rng)
    with torch.no_grad():
        mean = agent.policy(
            agent.normalizer(torch.from_numpy(rollout.observation[:-1])),
            torch.from_numpy(rollout.latent).expand(len(rollout.action), -1, -1),
        )
        wanted = gaussian.log_prob(torch.from_numpy(rollout.action), mean, agent.policy.std)
    np.testing.assert_allclose(rollout.log_prob, wanted.numpy(), atol=1e-4)


def test_what_comes_behind_a_failure_is_not_learned_from() -> None:
    trained = learner()
    assert isinstance(RECIPE.task, PointTask)
    env, pool = Breaking(RECIPE.task, SAWYER, skill_goals(RECIPE.task), 8), StartPool(100)
    rollout = collect(env, trained.agent, pool, 0.0, trained.rng)
    assert rollout.valid[:, 1].tolist() == [True] * 3 + [False] * 7
    assert np.isinf(rollout.final_distance[1]) and np.isfinite(np.delete(rollout.final_distance, 1)).all()
    assert 4 * 7 <= pool.filled <= 4 * 7 + 3, "nobody starts where someone failed"
    failing = Learner(env, RECIPE, 0)
    assert all(np.isfinite(list(failing.iterate().values())))


def test_the_pool_is_a_ring_of_the_latest_states() -> None:
    pool = StartPool(3)
    pool.add(np.array([[1.0], [2]]))
    assert pool.filled == 2 and set(pool.draw(50, np.random.default_rng(0)).ravel()) == {1, 2}
    pool.add(np.array([[3.0], [4]]))
    assert pool.filled == 3 and set(pool.draw(50, np.random.default_rng(0)).ravel()) == {2, 3, 4}
    pool.add(np.array([[5.0]]))
    assert set(pool.draw(50, np.random.default_rng(0)).ravel()) == {3, 4, 5}


def test_chained_episodes_begin_where_earlier_ones_passed() -> None:
    env, rng, pool = make_env(PointTask(), 400), np.random.default_rng(0), StartPool(10)
    start_episodes(env, pool, 0.7, rng)
    assert (env.achieved_goal() == 0).all(), "nothing has passed anywhere yet"
    pool.add(np.array([[1.0, 2.0]]))
    skills = start_episodes(env, pool, 0.7, rng)
    passed = (env.achieved_goal()[:, :2] == [1, 2]).all(axis=1)
    assert float(passed.mean()) == pytest.approx(0.7, abs=0.06)
    np.testing.assert_array_equal(env.desired_goal, env.goals[skills])
    assert np.bincount(skills).tolist() == [100] * 4


def test_skills_that_fail_get_more_of_the_episodes() -> None:
    env, rng, pool = make_env(PointTask(), 40), np.random.default_rng(0), StartPool(10)
    assert np.bincount(start_episodes(env, pool, 0.0, rng, np.array([1.0, 0.2, 0.5, 0.3]))).tolist() == [20, 4, 10, 6]
    drawn = [np.bincount(start_episodes(env, pool, 0.0, rng, np.array([1.0, 1.0, 1.0, 0.15]))) for _ in range(400)]
    assert {*map(tuple, np.abs(np.array(drawn) - 40 / 3.15 * np.array([1, 1, 1, 0.15])).round(5) < 1)} == {(True,) * 4}
    np.testing.assert_allclose(np.mean(drawn, axis=0), 40 / 3.15 * np.array([1, 1, 1, 0.15]), atol=0.1)

    trained = learner(recipe=resolve(RECIPE.model_dump(mode="json"), ["training.favour_failing=0.8"]))
    trained.curves = {f"success/{skill + 1}": [1.0] * 5 + [rate] * 10 for skill, rate in enumerate((0.0, 1.0, 0.5, 0.25))}
    trained.iteration = 15
    np.testing.assert_allclose(trained._odds(), [1.0, 0.2, 0.6, 0.8])
    assert learner()._odds() is None, "as drawn without the key"


def test_a_value_function_may_see_the_way_to_the_goal_and_nothing_else_does() -> None:
    recipe = resolve(RECIPE.model_dump(mode="json"), ["network.value_sees_goal=true", "training.chained_starts=0.0"])
    trained = learner(recipe=recipe)
    rollout = collect(trained.env, trained.agent, trained.pool, 0.0, trained.rng, sees_goal=True)
    assert rollout.privileged.shape == (11, 8, WAY_SIZE) and rollout.observation.shape == (11, 8, 2)
    np.testing.assert_allclose(rollout.privileged[0], np.c_[trained.env.goals[rollout.skill], np.full(8, 3.0)], rtol=1e-6)
    np.testing.assert_allclose(rollout.privileged[1:, :, -1], -rollout.reward, rtol=1e-5)
    plain = learner()
    assert trained.agent.policy.body[0].in_features == plain.agent.policy.body[0].in_features
    assert trained.agent.value.body[0].in_features == plain.agent.value.body[0].in_features + WAY_SIZE
    resumed = run(learner(recipe=recipe), 1)
    resumed.load(*run(trained, 2).state())
    assert same(run(resumed, 1), run(trained, 1))


def test_what_a_task_shows_the_value_function_comes_before_the_way() -> None:
    env = Perturbed(PointTask(), 3)
    env.reset(np.arange(3), np.array([0, 1, 2]))
    env.randomize({"gain": np.array([[1.0], [2.0], [3.0]])}, np.random.default_rng(0))
    shown = privileged(env, True)
    assert shown.dtype == np.float32
    np.testing.assert_allclose(shown, [[0.1, 0, 3, 0, 3], [0.2, 3, 0, 0, 3], [0.3, 0, -3, 0, 3]], rtol=1e-6)
    np.testing.assert_array_equal(privileged(env, False), env.privileged())


class Perturbed(PointEnvironment):
    """Remembers what each rollout was perturbed with, and whether the value function may see it."""

    privileged_size = 1

    def __init__(self, task: PointTask, num_envs: int) -> None:
        self.given: list[dict[str, Array]] = []
        super().__init__(task, SAWYER, skill_goals(task), num_envs)

    def randomize(self, parameters: Mapping[str, Array], rng: np.random.Generator) -> None:
        self.given.append({name: values.copy() for name, values in parameters.items()})
        super().randomize(parameters, rng)

    def privileged(self) -> Array:
        return (self._step_limit * self._gain).astype(np.float32)


def perturbed(*changes: str, num_envs: int = 400) -> list[dict[str, Array]]:
    """What ten iterations of two steps perturb their simulations with."""
    overrides = ["training.iterations=10", "task.horizon=2", "training.epochs=1", *changes]
    recipe = resolve(RECIPE.model_dump(mode="json"), overrides)
    assert isinstance(recipe.task, PointTask)
    env = Perturbed(recipe.task, num_envs)
    run(Learner(env, recipe, 0), 10)
    return env.given


def reached(given: list[dict[str, Array]], name: str, neutral: float = 0.0) -> list[float]:
    """The share of the simulations that a parameter is not neutral in, in each iteration."""
    return [float((each[name].reshape(len(each[name]), -1) != neutral).any(axis=1).mean()) for each in given]


def test_what_is_phased_in_reaches_a_growing_share_of_the_simulations() -> None:
    given = perturbed(
        "randomisation.dynamics.gain={uniform=[0.5, 0.9]}", "randomisation.starts.start_offset={uniform=[-0.1, 0.1]}",
        "randomisation.sensing.position_noise={uniform=[0.01, 0.02]}", "randomisation.sensing.joint_noise=0.01",
        "randomisation.starts_span=[0.0, 0.4]", "randomisation.sensing_span=[0.2, 0.6]",
    )  # fmt: skip
    assert len(given) == 10
    starts, sensing = reached(given, "start_offset"), reached(given, "position_noise")
    assert starts[0] == 0 and starts[4:] == [1] * 6 and starts[1:4] == pytest.approx([0.25, 0.5, 0.75], abs=0.08)
    assert sensing[:3] == [0] * 3 and sensing[6:] == [1] * 4 and sensing[3:6] == pytest.approx([0.25, 0.5, 0.75], abs=0.08)
    assert reached(given, "gain", 1.0) == [1] * 10, "dynamics from the first iteration on"
    for each in given:
        np.testing.assert_array_equal(each["joint_noise"] > 0, each["position_noise"] > 0, err_msg="all of a group at once")
        assert each["gain"].min() >= 0.5 and each["gain"].max() <= 0.9 and np.ptp(each["gain"]) > 0.35
    both = (given[3]["position_noise"] > 0) & (given[3]["start_offset"] != 0).any(axis=1)
    assert float(both.mean()) == pytest.approx(0.25 * 0.75, abs=0.08), "each group by its own chance"
    assert not np.array_equal(given[8]["gain"], given[9]["gain"]), "anew for every episode"


def test_a_span_without_length_begins_everywhere_at_once() -> None:
    given = perturbed(
        "randomisation.starts.start_offset=0.1", "randomisation.sensing.position_noise=0.01",
        "randomisation.starts_span=[0, 0]", "randomisation.sensing_span=[0.3, 0.3]", num_envs=8,
    )  # fmt: skip
    assert reached(given, "start_offset") == [1] * 10
    assert reached(given, "position_noise") == [0] * 3 + [1] * 7


def test_without_randomisation_nothing_is_perturbed_and_no_chance_is_spent() -> None:
    assert perturbed("randomisation.starts_span=[0, 0]", num_envs=8) == []
    plain = learner()
    waiting = learner(recipe=resolve(RECIPE.model_dump(mode="json"), ["randomisation.sensing_span=[0, 0]"]))
    assert same(run(plain, 2), run(waiting, 2))


def test_the_value_function_sees_what_is_privileged_and_the_policy_does_not() -> None:
    recipe = resolve(RANDOMISED.model_dump(mode="json"))
    assert isinstance(recipe.task, PointTask)
    trained = run(Learner(Perturbed(recipe.task, 8), recipe, 0), 1)
    rollout = collect(trained.env, trained.agent, trained.pool, 0.0, trained.rng)
    assert rollout.privileged.shape == (11, 8, 1) and (rollout.privileged == rollout.privileged[0]).all()
    batch, _ = te_ppo.prepare(rollout, trained.agent, recipe.training)
    assert batch.privileged.shape == (80, 1) and float(batch.privileged.std()) > 0.1
    blind = replace(rollout, privileged=rollout.privileged * 0)
    other, _ = te_ppo.prepare(blind, trained.agent, recipe.training)
    assert not torch.equal(other.value_target, batch.value_target) and torch.equal(other.old_log_prob, batch.old_log_prob)
    te_ppo.update(batch, trained.agent, trained.optimizers, recipe.training, 0.0, trained.rng)
    weight = next(trained.agent.value.parameters())
    assert weight.grad is not None and float(weight.grad[:, 2].abs().max()) > 0, "behind the two numbers observed"


def test_every_term_of_the_reward_is_a_curve_and_together_they_are_the_return() -> None:
    trained = run(learner(), 3)
    terms = [np.array(values) for name, values in trained.curves.items() if name.startswith("reward/")]
    assert len(terms) == 1 and terms[0].shape == (3,)
    np.testing.assert_allclose(sum(terms), trained.curves["return"], rtol=1e-5)
