"""Composing stages: what a plan by hand asks for, what is stored of a composer, and that nothing is left of a broken one."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import files
from worlds import SAWYER

from skillcli.errors import UsageError
from skillcli.evaluation.inputs import compose_inputs
from skillcli.evaluation.request import Request
from skillcli.progress import Progress
from skillcli.recipe import Recipe, load_recipe, resolve
from skillcli.robots.robot import Robot
from skillcli.stages.compose import compose
from skillcli.store import ArtifactId, Store
from skillcli.tasks.world import World, skill_goals

REACH, PUSH = load_recipe("reach"), load_recipe("push")
DDPG = [
    "ddpg.simulations=4",
    "ddpg.iterations=3",
    "ddpg.seconds=0.5",
    "ddpg.gradient_steps=2",
    "ddpg.warm_up=1",
    "ddpg.good_enough=0",
]


def slow_arm(limit: float) -> Robot:
    return replace(SAWYER, speed_limit=np.full(7, limit))


@pytest.fixture
def copy(chain: Path, tmp_path: Path) -> Store:
    """A store of one's own with the tiny chain in it."""
    return Store(shutil.copytree(chain, tmp_path / "artifacts"))


def asked(recipe: Recipe, method: str, *settings: str, task: str = "", goals: tuple[tuple[float, ...], ...] = ()) -> Request:
    return Request.of(resolve(recipe.model_dump(mode="json"), settings), task, goals, method)


def test_the_u_shape_goes_through_its_four_skills() -> None:
    request = asked(REACH, "interpolate", task="u-shape")
    assert [entry.text for entry in request.entries[0]] == ["3", "3~4", "4", "4~8", "8", "8~7", "7"]
    np.testing.assert_array_equal(request.waypoints, skill_goals(REACH.task)[[2, 3, 7, 6]])
    assert asked(REACH, "interpolate").entries == request.entries, "it is what is done where nothing is asked"


def test_pairs_and_neighbours_are_routes_of_two_skills_each() -> None:
    assert len(asked(REACH, "interpolate", task="pairs").routes) == 28
    assert len(asked(REACH, "interpolate", task="neighbours").routes) == 12
    pushes = asked(PUSH, "interpolate")
    assert [route[0].text for route in pushes.entries] == ["up", "up", "down", "down"], "the four sides, not the diagonals"


def test_a_plan_by_hand_is_judged_by_what_it_holds_or_by_what_is_asked() -> None:
    own = asked(PUSH, "sequence", 'sequence.plan="up,left"')
    np.testing.assert_allclose(own.waypoints - [0.6, 0, 0], [[0.15, 0, 0], [0, 0.15, 0]])
    other = asked(PUSH, "sequence", 'sequence.plan="1,3"', goals=((0.1, 0.1),))
    np.testing.assert_allclose(other.waypoints, [[0.7, 0.1, 0]])
    assert [entry.a for entry in other.entries[0]] == [entry.a for entry in own.entries[0]] == [0, 2]
    with pytest.raises(UsageError, match="12 routes"):
        asked(PUSH, "sequence", "sequence.plan=up", task="ring")


def test_what_a_composition_depends_on_is_its_method_its_settings_and_its_seed(chain: Path) -> None:
    source = Store(chain).read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe)
    world, request = World.of(recipe), Request.of(recipe, "", [(0.6, 0.1, 0.25)])
    same = compose_inputs(source, resolve(source.recipe, ["mpc.samples=99"]), world, request, "ddpg")
    found = {
        compose_inputs(source, recipe, world, request, "ddpg"),
        compose_inputs(source, recipe, world, request, "ddpg", seed=1),
        compose_inputs(source, recipe, world, request, "ppo"),
        compose_inputs(source, resolve(source.recipe, ["ddpg.noise=0.1"]), world, request, "ddpg"),
    }
    assert len(found) == 4 and same in found


def test_a_composer_is_stored_with_weights_curves_and_the_plan_it_made(copy: Store) -> None:
    store = copy
    source = store.read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe, DDPG)
    request = Request.of(recipe, "", [(0.6, 0.1, 0.25)])
    told: list[Progress] = []
    artifact = compose(store, source.id, recipe, request, "ddpg", "test", "composer", told.append)
    assert artifact.arrays["composer/actor.body.0.weight"].shape == (64, 10 + 3), "observation and gap to the goal"
    assert artifact.arrays["curves/env_steps"].tolist() == [40, 80, 120] and len(artifact.arrays["curves/return"]) == 3
    assert artifact.arrays["plan/latent"].shape == (2, 3) and artifact.arrays["plan/skill"].tolist() == [-1, -1]
    assert artifact.results["simulated_robot_seconds"] == pytest.approx(120 * 0.05)
    greedy = artifact.arrays["curves/greedy_final_distance"].min()
    assert artifact.results["final_distance_m"] == pytest.approx(greedy, abs=1e-4), "executed as it was found"
    assert told and told[-1].done <= told[-1].total == 3


def test_calibration_ends_where_the_skills_end(copy: Store) -> None:
    store = copy
    source = store.read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe, ["interpolate.shares=3", "interpolate.hold=0.1", "interpolate.blend=0.2"])
    artifact = compose(store, source.id, recipe, asked(recipe, "interpolate"), "interpolate", "test", "line")
    pair, end = artifact.arrays["calibration/pair"], artifact.arrays["calibration/end"]
    played = source.group("trajectories")["gripper_position"][:8, -1]
    np.testing.assert_allclose(end[:, 0], played[pair[:, 0]], atol=1e-5)
    np.testing.assert_allclose(end[:, -1], played[pair[:, 1]], atol=1e-5)
    assert artifact.arrays["plan/latent_end"].shape == artifact.arrays["plan/latent"].shape == (7, 3)
    steps = artifact.group("trajectories")["latent"][0]
    mean = source.arrays["embedding/mean"]
    np.testing.assert_allclose(steps[3], (mean[2] * 3 + mean[3] * 2) / 5, atol=1e-6, err_msg="two fifths into the first blend")


@pytest.mark.parametrize("method", ["search", "ddpg", "ppo", "mpc"])
def test_an_interrupted_composition_leaves_nothing(chain: Path, method: str) -> None:
    def interrupt(_: Progress) -> None:
        raise KeyboardInterrupt

    before = files(chain)
    store = Store(chain)
    source = store.read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe, [*DDPG, "ppo.simulations=4", "mpc.samples=8", "mpc.elites=2"])
    request = Request.of(recipe, "", [(0.6, 0.1, 0.25)])
    with pytest.raises(KeyboardInterrupt):
        compose(store, source.id, recipe, request, method, "test", "stopped", interrupt)
    assert files(chain) == before


# --- safety limits ----------------------------------------------------------------------------------------------------


def test_a_plan_that_breaks_a_limit_is_no_success_and_says_where(copy: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    source = copy.read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe, ["sequence.plan=1:0.2,2:0.2"])
    request = asked(recipe, "sequence")
    first = compose(copy, source.id, recipe, request, "sequence", "test")
    end = first.arrays["trajectories/gripper_position"][:, -1].astype(float)
    request = replace(request, routes=(end,))  # asked for what it does
    kept = compose(copy, source.id, recipe, request, "sequence", "test")
    assert kept.results["success"] and (kept.results["violations"], kept.results["broken"]) == ({}, [])

    speed = np.abs(np.diff(kept.arrays["trajectories/joint_position"][0], axis=0)) / 0.05
    monkeypatch.setattr("skillcli.tasks.world.load_robot", lambda _: slow_arm(0.5 * speed.max()))
    broken = compose(copy, source.id, recipe, request, "sequence", "test")
    (found,) = broken.results["broken"]
    path, steps = broken.arrays["trajectories/violations"][0], broken.arrays["trajectories/violated"][0, :, 1]
    assert found["limit"] == "joint_speed" and found["route"] == 0 and 0 < found["control_steps"] <= 8
    assert broken.results["violations"] == {"joint_speed": found["control_steps"]} == {"joint_speed": path[1]}
    step = round(found["seconds"] / 0.05)
    assert found["segment"] == (step - 1) // 4 and step >= 1
    assert steps.sum() == path[1] and steps.argmax() == step - 1 and "trajectories/violated" not in kept.arrays
    assert found["gripper_m"] == pytest.approx(broken.arrays["trajectories/gripper_position"][0, step], abs=1e-6)
    assert not broken.results["success"] and broken.results["success_rate"] == 0
    assert broken.results["waypoints_met"] == kept.results["waypoints_met"] == kept.results["success"]


def test_a_search_keeps_the_limits_where_there_is_a_way_to(copy: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    source = copy.read(ArtifactId("tiny", "embed-means", 1))
    recipe = resolve(source.recipe, ["search.budget=4", "search.segments=[0.2]"])
    request = Request.of(recipe, "", [(0.6, 0.1, 0.25)])
    fast = compose(copy, source.id, recipe, request, "search", "test")
    speed = np.abs(np.diff(fast.arrays["trajectories/joint_position"][0], axis=0)) / 0.05
    monkeypatch.setattr(
        "skillcli.tasks.world.load_robot", lambda _: replace(SAWYER, speed_limit=np.full(7, 0.95 * speed.max()))
    )
    slow = compose(copy, source.id, recipe, request, "search", "test")
    assert slow.results["violations"] == {} and slow.arrays["trajectories/violations"].sum() == 0
    assert slow.results["final_distance_m"] >= fast.results["final_distance_m"]
