"""Plans for several robots, plans on the target itself, and plans that are made again on the way."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import made, skill
from worlds import JOINTS, SAWYER, make_env, world

from skillcli.config.randomization import PARAMETERS
from skillcli.evaluation.replanned_episode import ReplannedEpisode
from skillcli.evaluation.replanning import Replanner
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.recipe import Compose, resolve
from skillcli.simulation.domains import find_domain
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.tasks.reach.settings import ReachTask

GOAL = ("--goal", "0.6,0.1,0.2")
QUICK = ("--set", "search.budget=3", "--set", "mpc.samples=4", "--set", "mpc.elites=2", "--set", "mpc.seconds=0.5")


def test_the_first_robot_of_an_ensemble_is_the_nominal_one_and_the_others_fill_the_domain() -> None:
    robots = SampledRobots.ensemble("real-like", 9, 0, JOINTS)
    ranges = find_domain("real-like").parameters
    assert robots.count == 9 and set(robots.parameters) == set(ranges)
    for name, values in robots.parameters.items():
        assert len(values) == 9 and (values[0] == (1.0 if PARAMETERS[name][1] == "factor" else 0.0)).all()
    assert np.count_nonzero(robots.parameters["latency"][1:]) == 4, "half of them are late, not by chance"


def test_what_a_composition_asks_for() -> None:
    assert SampledRobots.of(Compose(), "", 0, JOINTS) == SampledRobots()
    assert SampledRobots.of(Compose(ensemble=3), "", 0, JOINTS).count == 3
    on = SampledRobots.of(Compose(ensemble=3), "real-like", 0, JOINTS)
    assert on.count == 1 and on.parameters["gain"].shape == (1, 7), "who plans on the target plans for no other robot"


def test_simulation_i_is_robot_i_modulo_their_number() -> None:
    robots = SampledRobots.ensemble("real-like", 3, 1, JOINTS)
    env = robots.make_env(world(ReachTask()), 2)
    start = env.save(np.arange(6))
    env.step(np.full((6, 7), 0.5))
    moved = env.achieved_goal()
    np.testing.assert_array_equal(moved[:3], moved[3:])
    assert len(np.unique(np.round(moved[:3], 9), axis=0)) == 3 and len(start) == 6


def compose_on(chain: Path, tmp_path: Path, *words: str) -> tuple[Path, dict[str, Any], Artifact]:
    store = tmp_path / "artifacts"
    shutil.copytree(chain, store)
    found = made("--store", store, "compose", "tiny/embed-means", *GOAL, *QUICK, *words)
    assert Store(store).verify(ArtifactId.parse(found["id"])) == []
    return store, found, Store(store).read(ArtifactId.parse(found["id"]))


@pytest.mark.parametrize("method", ["search", "mpc"])
def test_a_plan_for_several_robots_keeps_them_and_counts_the_time_of_all(chain: Path, tmp_path: Path, method: str) -> None:
    _, one, _ = compose_on(chain, tmp_path / "one", "--method", method)
    _, three, artifact = compose_on(chain, tmp_path / "three", "--method", method, "--ensemble", "3")
    assert (one["robots"], three["robots"]) == (1, 3) and artifact.arrays["robots/gain"].shape == (3, 7)
    assert three["robot_seconds_with_returns"] >= three["simulated_robot_seconds"] > 0
    if method == "search":  # as many nodes, each on three robots
        assert three["simulated_robot_seconds"] == pytest.approx(3 * one["simulated_robot_seconds"])


def test_a_plan_on_the_target_is_executed_there(chain: Path, tmp_path: Path) -> None:
    _, found, artifact = compose_on(chain, tmp_path, "--on", "real-like", "--seed", "2")
    assert found["on"] == "real-like" and found["robots"] == 1 and artifact.seed == 2
    drawn = SampledRobots.drawn("real-like", 2, JOINTS)
    for name, values in drawn.parameters.items():
        np.testing.assert_array_equal(artifact.arrays[f"robots/{name}"], values)
    start = artifact.arrays["trajectories/joint_position"][0, 0]
    offset = drawn.parameters["start_offset"][0]
    np.testing.assert_allclose(start, np.array(SAWYER.start("reach")) + offset, atol=1e-6)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--on", "real-like", "--ensemble", "3"), "leave one of them out"),
        (("--on", "nowhere"), "no domain 'nowhere'"),
        (("--set", "compose.robots=nowhere", "--ensemble", "3"), "no domain 'nowhere'"),
        (("--method", "sequence", "--plan", "3", "--ensemble", "3"), "--ensemble belongs to --method search or map or mpc"),
    ],
)
def test_what_cannot_be_planned_on_is_refused(chain: Path, words: tuple[str, ...], said: str) -> None:
    goal = () if "sequence" in words else GOAL
    result = skill("--store", chain, "--json", "compose", "tiny/embed-means", *goal, *words)
    error = result.json["error"]
    assert result.code == 2 and said in f"{error['message']} {error['hint']}", result


def replanned(store: Path, *words: str) -> dict[str, Any]:
    return made("--store", store, "transfer-eval", "tiny/compose", "--replan", "--set", "transfer.replan_budget=2",
                "--set", "transfer.replan_seconds=0.6", "--episodes", "2", *words)  # fmt: skip


@pytest.mark.parametrize("method", ["search", "mpc"])
def test_replanning_sends_other_latents_to_the_same_robots(chain: Path, tmp_path: Path, method: str) -> None:
    store, plan, _ = compose_on(chain, tmp_path, "--method", method)
    assert plan["id"] == "tiny/compose-v2"
    blind = made("--store", store, "transfer-eval", "tiny/compose", "--domain", "real-like", "--episodes", "2")
    found = replanned(store, "--domain", "real-like")
    again = replanned(store, "--domain", "real-like")
    read = {which["id"]: Store(store).read(ArtifactId.parse(which["id"])) for which in (blind, found, again)}
    first, second, third = read.values()
    for name in find_domain("real-like").parameters:
        np.testing.assert_array_equal(first.arrays[f"domains/real-like/{name}"], second.arrays[f"domains/real-like/{name}"])
    assert second.content_sha256 == third.content_sha256 != first.content_sha256
    assert found["replanned"] and not blind["replanned"] and found["seconds_per_plan"] > 0
    assert (second.arrays["trajectories/length"] <= 36).all(), "0.6 s, and three times that while it comes nearer"


def test_bare_skills_and_plans_by_hand_cannot_be_made_again(chain: Path, tmp_path: Path) -> None:
    store = tmp_path / "artifacts"
    shutil.copytree(chain, store)
    by_hand = made("--store", store, "compose", "tiny/embed-means", "--method", "sequence", "--plan", "3:0.2,4:0.2")
    for source, said in (("tiny/embed-means", "holds no plan"), (by_hand["id"], "--replan goes with search or mpc")):
        result = skill("--store", store, "--json", "transfer-eval", source, "--replan")
        error = result.json["error"]
        assert result.code == 2 and said in f"{error['message']} {error['hint']}", result


class Perfect:
    """A library whose latent is the action itself: the first three joints."""

    class agent:
        @staticmethod
        def act(observation: np.ndarray, latent: np.ndarray) -> np.ndarray:
            action = np.zeros((len(latent), 7))
            action[:, :3] = latent
            return action

    mean = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0.5]])
    std = np.full((5, 3), 0.1)
    goals = np.zeros((5, 3))
    names = ("left", "right", "down", "up", "still")
    world = world(ReachTask())


@pytest.mark.parametrize("push", [0.0, 0.3])
@pytest.mark.slow
def test_replanning_arrives_although_the_robot_starts_elsewhere(push: float) -> None:
    recipe = resolve({"name": "r", "task": {"name": "reach"}, "search": {"segments": [0.1, 0.4], "weight": 4.0}})
    replanner = Replanner(Perfect(), recipe, "search")  # type: ignore[arg-type]
    target = make_env(recipe.task, 1)
    target.randomize({"start_offset": np.array([[push, 0, 0, 0, 0, 0, 0]])}, np.random.default_rng(0))
    target.reset(np.array([0]), np.array([0]))
    waypoints = np.array([[0.6, 0.2, 0.25], [0.6, 0.0, 0.25]])
    episode = replanner.episode(target, waypoints, 120, seed=0)
    assert episode.success[0] and episode.length[0] < 120, "it stops where it arrives"
    assert np.linalg.norm(episode.achieved_goal[0, -1] - waypoints[-1]) < 0.025
    assert replanner.effort.plans >= 4 and replanner.effort.seconds > 0


def test_after_half_of_the_time_what_the_judge_takes_is_near_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ReplannedEpisode, "_hopeless", lambda _: False)  # however sure a plan is to end nearer
    near = {"segments": [0.1], "weight": 4.0, "goal_tolerance": 1e-6}  # m: no two of these actions lead there
    recipe = resolve({"name": "r", "task": {"name": "reach"}, "search": near, "transfer": {"replan_budget": 4}})
    target = make_env(recipe.task, 1)
    target.reset(np.array([0]), np.array([0]))
    episode = Replanner(Perfect(), recipe, "search").episode(target, np.array([[0.6, 0.1, 0.25]]), 60, seed=0)
    assert episode.success[0] and 30 <= episode.length[0] < 60
