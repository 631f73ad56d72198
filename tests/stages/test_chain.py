"""The stages on a tiny chain: what each artifact holds, and that equal inputs give equal artifacts."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from command import CHAIN
from worlds import JOINTS

from skillcli import metrics
from skillcli.composition.plan import Segment
from skillcli.errors import UsageError
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.library import open_library
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.evaluation.transfer_evaluator import NOMINAL, TargetRobots, TransferEvaluator
from skillcli.learning.agent import Agent
from skillcli.recipe import resolve
from skillcli.robots.robot import Robot, load_robot
from skillcli.simulation.domains import find_domain
from skillcli.stages.compose import Request, compose, execute
from skillcli.stages.pretrain import evaluate, pretrain
from skillcli.stages.transfer_eval import transfer_eval
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.tasks.world import World, skill_goals
from skillcli.trajectories import Trajectories


def read(chain: Path, stage: str) -> Artifact:
    return Store(chain).read(ArtifactId("tiny", stage, 1))


def recording(artifact: Artifact) -> Trajectories:
    return Trajectories(**artifact.group("trajectories"))


@pytest.mark.parametrize("stage", CHAIN)
def test_every_artifact_is_whole_and_knows_where_it_comes_from(chain: Path, stage: str) -> None:
    store, artifact = Store(chain), read(chain, stage)
    assert store.verify(artifact.id) == []
    before = CHAIN.index(stage) - 1
    assert [str(parent.id) for parent in artifact.parents] == ([f"tiny/{CHAIN[before]}-v1"] if stage != "pretrain" else [])
    assert len(store.lineage(artifact.id)) == CHAIN.index(stage)
    assert artifact.seed == 0 and artifact.recipe_name == "smoke" and artifact.model_sha256 and artifact.inputs_sha256
    assert artifact.command.startswith("skill run smoke --name tiny --set training.iterations=2")


@pytest.mark.parametrize("stage", CHAIN)
def test_recordings_agree_with_themselves(chain: Path, stage: str) -> None:
    artifact, path = read(chain, stage), recording(read(chain, stage))
    episodes, steps = path.skill.shape
    assert path.time.shape == (steps + 1,) and np.allclose(np.diff(path.time), 0.05)
    assert path.joint_position is not None and path.joint_position.shape == (episodes, steps + 1, 7)
    assert path.gripper_position is not None and path.gripper_position.shape == (episodes, steps + 1, 3)
    assert path.action.shape == (episodes, steps, 7) and np.abs(path.action).max() <= np.float32(0.04)
    assert (path.length == steps).all(), "nothing failed"
    for array in path.arrays().values():
        assert np.isfinite(array).all()
    if stage in ("pretrain", "embed-means"):
        distance = np.linalg.norm(path.gripper_position[:, 1:] - path.target[:, None], axis=2)
        np.testing.assert_allclose(path.reward, -distance, atol=1e-5)
        np.testing.assert_array_equal(path.success, metrics.final_distance(path) <= resolve(artifact.recipe).task.tolerance)


def test_pretrain_reports_what_it_holds(chain: Path) -> None:
    artifact = read(chain, "pretrain")
    results, measured, arrays = artifact.results, artifact.measured, artifact.arrays
    assert results["env_steps"] == 2 * 16 * 16
    assert [skill["name"] for skill in results["skills"]] == [str(k) for k in range(1, 9)]
    for k, skill in enumerate(results["skills"]):
        assert skill["goal"] == arrays["skills/goal"][k].tolist()
        assert skill["final_distance_m"] == pytest.approx(arrays["evaluation/final_distance"][k, 0])
    assert results["embedding"].keys() == {"inference_accuracy", "latent_goal_correlation", "efficiency"}
    throughput = measured["throughput"]
    rate = throughput["physics_limit_env_steps_per_second"]
    assert throughput["training_ratio"] == pytest.approx(throughput["env_steps_per_second"] / rate)
    assert throughput["env_steps_per_second"] == pytest.approx(results["env_steps"] / measured["wall_seconds"])
    assert 0 < throughput["training_ratio"] < throughput["sampling_ratio"]
    assert arrays["curves/return"].shape == arrays["curves/success/1"].shape == (2,)
    assert arrays["evaluation/latent"].shape == (8, 4, 3), "the mean and three samples"
    np.testing.assert_array_equal(arrays["evaluation/latent"][:, 0], arrays["embedding/mean"])
    assert recording(artifact).episodes == 8 * 2, "the mean and one sample"
    assert results["randomised"] is None, "nothing differed in training"


def test_stored_skills_act_as_the_trained_ones_did(chain: Path) -> None:
    artifact = read(chain, "pretrain")
    library = open_library(Store(chain), artifact)
    again = evaluate(library.recipe, library.world, library.agent, seed=0, threads=1)
    np.testing.assert_array_equal(again.final_distance, artifact.arrays["evaluation/final_distance"])
    np.testing.assert_array_equal(again.inferred, artifact.arrays["evaluation/inferred"])


def test_embed_means_plays_each_skill_at_its_mean(chain: Path) -> None:
    source, artifact = read(chain, "pretrain"), read(chain, "embed-means")
    path = recording(artifact)
    np.testing.assert_array_equal(artifact.arrays["embedding/mean"], source.arrays["embedding/mean"])
    assert path.skill.shape == (8 + 12, 16), "eight corners and twelve edges"
    np.testing.assert_array_equal(path.skill[:8], np.repeat(np.arange(8)[:, None], 16, axis=1))
    np.testing.assert_allclose(path.latent[:8, 0], source.arrays["embedding/mean"], atol=1e-6)
    means, played = source.results["skills"], artifact.results["skills"]
    assert [s["final_distance_m"] for s in played] == pytest.approx([s["final_distance_m"] for s in means], abs=1e-6)
    low, high = artifact.arrays["embedding/bounds"]
    assert (low < artifact.arrays["embedding/mean"]).all() and (artifact.arrays["embedding/mean"] < high).all()


def test_embed_means_plays_the_mean_of_neighbouring_latents_against_half_way_between_their_goals(chain: Path) -> None:
    artifact = read(chain, "embed-means")
    pairs, mean, goals = (artifact.arrays[name] for name in ("halfway/pair", "embedding/mean", "skills/goal"))
    path = recording(artifact).select(slice(8, None))
    assert [tuple(pair) for pair in pairs] == metrics.neighbours(goals) and len(pairs) == 12
    assert (path.skill == -1).all(), "the mean of no skill"
    np.testing.assert_allclose(path.latent[:, 0], (mean[pairs[:, 0]] + mean[pairs[:, 1]]) / 2, atol=1e-6)
    np.testing.assert_allclose(path.target, (goals[pairs[:, 0]] + goals[pairs[:, 1]]) / 2)
    start, end = path.achieved_goal[:, 0], path.achieved_goal[:, -1]
    for row, found in enumerate(artifact.results["halfway"]):
        assert (found["from"], found["to"]) == tuple(str(k + 1) for k in pairs[row])
        assert found["final_distance_m"] == pytest.approx(np.linalg.norm(end[row] - path.target[row]))
        assert found["moved_m"] == pytest.approx(end[row] - start[row])
        moved, wanted = end[row] - start[row], path.target[row] - start[row]
        assert found["direction_error_deg"] == pytest.approx(metrics.angle_deg(moved, wanted))
        assert found["magnitude_ratio"] == pytest.approx(np.linalg.norm(moved) / np.linalg.norm(wanted))


def test_the_plan_in_the_artifact_is_what_was_executed(chain: Path) -> None:
    artifact = read(chain, "compose")
    results, arrays, path = artifact.results, artifact.arrays, recording(artifact)
    assert path.episodes == 1
    steps = np.round(arrays["plan/seconds"] / 0.05).astype(int)
    assert path.skill.shape[1] == steps.sum() == round(results["plan_seconds"] / 0.05)
    np.testing.assert_allclose(path.latent[0], np.repeat(arrays["plan/latent"], steps, axis=0), atol=1e-6)
    np.testing.assert_array_equal(path.skill[0], np.repeat(arrays["plan/skill"], steps))
    assert [segment["seconds"] for segment in results["segments"]] == pytest.approx(arrays["plan/seconds"].tolist())
    closest = metrics.ordered_approach(path.achieved_goal[0], arrays["waypoints/target"], 0.05)
    np.testing.assert_allclose(arrays["waypoints/closest"], closest)
    assert results["final_distance_m"] == pytest.approx(metrics.final_distance(path)[0])
    assert 0 < results["expanded_nodes"] <= 12 and results["simulated_robot_seconds"] > 0
    assert results["success"] == bool(path.success[0]) == bool((closest <= 0.05).all() and results["final_distance_m"] <= 0.05)


def test_what_the_search_saw_is_what_the_plan_does(chain: Path) -> None:
    store, artifact = Store(chain), read(chain, "compose")
    library = open_library(store, artifact)
    steps = np.round(artifact.arrays["plan/seconds"] / 0.05).astype(int)
    plan = [
        Segment(latent, int(skill), "", int(n))
        for latent, skill, n in zip(artifact.arrays["plan/latent"], artifact.arrays["plan/skill"], steps, strict=True)
    ]
    again = execute(library, plan, artifact.arrays["waypoints/target"], SampledRobots())
    np.testing.assert_array_equal(again.joint_position, recording(artifact).joint_position)


def test_transfer_summaries_follow_from_the_stored_episodes(chain: Path) -> None:
    artifact = read(chain, "transfer-eval")
    path, arrays = recording(artifact), artifact.arrays
    assert arrays["episodes/domain"].tolist() == [0] + [1] * 3, "the nominal robot does the same every time"
    np.testing.assert_allclose(arrays["episodes/final_distance"], metrics.final_distance(path))
    np.testing.assert_allclose(arrays["episodes/return"], path.reward.sum(axis=1))
    source = artifact.results["source"]
    assert source["episodes"] == 1
    for index, domain in enumerate(artifact.results["domains"]):
        here = arrays["episodes/domain"] == index
        distance = arrays["episodes/final_distance"][here]
        assert domain["successes"] == int(path.success[here].sum()) and domain["episodes"] == (1, 3)[index]
        exact = [domain["success_rate"]] * 2
        assert domain["ci95"] == pytest.approx((exact, metrics.wilson_interval(domain["successes"], 3))[index])
        assert domain["deterministic"] is (index == 0) and domain["unstable"] == 0
        found = domain["final_distance_m"]
        assert (found["mean"], found["median"]) == pytest.approx((distance.mean(), np.median(distance)))
        if source["success_rate"]:
            assert domain["retention"] == pytest.approx(domain["success_rate"] / source["success_rate"])
        else:
            assert domain["retention"] is None
    assert arrays["domains/mild/link_mass"].shape == (3, 7)


def test_the_nominal_domain_repeats_the_source_and_others_do_not(chain: Path) -> None:
    path, source = recording(read(chain, "transfer-eval")), recording(read(chain, "compose"))
    assert path.joint_position is not None and source.joint_position is not None
    np.testing.assert_allclose(path.joint_position[0], source.joint_position[0], atol=1e-5)
    gaps = [np.abs(path.joint_position[1 + e] - source.joint_position[0]).max() for e in range(3)]
    assert min(gaps) > 1e-4 and len(set(gaps)) == 3


def test_bare_skills_can_be_transferred_too(chain: Path) -> None:
    artifact = read(chain, "embed-means")
    library = open_library(Store(chain), artifact)
    target = TargetRobots.drawn(find_domain("real-like"), 10, 1, JOINTS)
    path, drawn = (
        TransferEvaluator(library, 1, library.world).run(EpisodeSchedule.of(artifact, library).in_turn(10), target),
        target.parameters,
    )
    assert path.skill[:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 0, 1]
    np.testing.assert_array_equal(path.target, library.goals[path.skill[:, 0]])
    assert set(drawn["latency"].tolist()) == {0.0, 0.05}
    assert math.isfinite(float(metrics.final_distance(path).max()))


def test_the_speed_of_an_approach_has_no_meaning_without_a_box_and_does_no_harm(chain: Path, tmp_path: Path) -> None:
    store, source = Store(shutil.copytree(chain, tmp_path / "artifacts")), read(chain, "embed-means")
    recipe = resolve(source.recipe, ["search.approach_speed=0.3"])
    again = compose(store, source.id, recipe, Request.of(recipe, "", ()), "search", "test")
    np.testing.assert_array_equal(again.arrays["plan/latent"], read(chain, "compose").arrays["plan/latent"])


def test_a_request_completes_plane_goals_and_takes_the_recipes_where_nothing_is_asked() -> None:
    point = resolve({"name": "p", "task": {"name": "point"}, "compose": {"task": "triangle"}})
    assert Request.of(point, "", [(1.0, 2.0)]).waypoints.tolist() == [[1, 2, 0]]
    assert Request.of(point, "", ()).task == "triangle"


def test_a_training_reads_its_robot_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read_robots: list[str] = []

    def load(which: str) -> Robot:
        read_robots.append(which)
        return load_robot(which)

    monkeypatch.setattr("skillcli.tasks.world.load_robot", load)
    recipe = resolve(
        {
            "name": "short",
            "task": {"name": "point", "horizon": 3},
            "training": {"iterations": 1, "simulations": 4},
            "randomisation": {"dynamics": {"gain": {"uniform": [0.9, 1.1]}}},
            "evaluation": {"latents": 2},
        }
    )
    pretrain(Store(tmp_path), recipe, 0, "short", "test")
    assert read_robots == ["sawyer"]


def test_a_window_longer_than_an_episode_is_padded_in_evaluation_as_in_training() -> None:
    recipe = resolve(
        {
            "name": "short",
            "task": {"name": "point", "horizon": 3},
            "embedding": {"size": 2, "window": 8},
            "evaluation": {"latents": 2},
        }
    )
    agent = Agent(recipe, 2, 2, skill_goals(recipe.task))
    assert evaluate(recipe, World.of(recipe), agent, 0).inferred.shape == (4, 3, 2)


def test_more_episodes_than_simulations_side_by_side_give_the_same_as_all_at_once(
    chain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = read(chain, "embed-means")
    library = open_library(Store(chain), source)
    script = EpisodeSchedule.of(source, library).in_turn(10)
    whole = TransferEvaluator(library, 0, library.world).run(script, NOMINAL)
    monkeypatch.setattr("skillcli.evaluation.transfer_evaluator.MAX_SIMULATIONS", 3)
    parts = TransferEvaluator(library, 0, library.world).run(script, NOMINAL)
    assert parts.gripper_position == pytest.approx(whole.gripper_position, abs=1e-4)
    assert parts.episodes == 10


def test_skills_can_only_be_composed_on_the_recipe_they_were_trained_on(chain: Path) -> None:
    store = Store(chain)
    source = read(chain, "embed-means")
    other = resolve(source.recipe, ["task.action_limit=0.1"])
    with pytest.raises(UsageError, match="trained on another recipe"):
        compose(store, source.id, other, Request.of(other, "triangle", ()), "search", "test")
    with pytest.raises(UsageError, match="trained on another recipe") as caught:
        transfer_eval(store, source.id, other, ["nominal"], 2, 0, "test")
    assert "transfer.*" in caught.value.hint
