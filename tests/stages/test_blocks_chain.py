"""A library that grasps goes through the stages like any other, as far as drivers and exported policies are not asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import made, skill

from skillcli.evaluation.library import open_library
from skillcli.store import ArtifactId, Store

pytestmark = pytest.mark.slow

TINY = (
    "training.iterations=1", "training.simulations=11", "training.minibatch=128", "task.horizon=6", "evaluation.latents=1",
    "evaluation.stored=1", "search.budget=1", "search.batch=4", "search.segments=[0.25]",
)  # fmt: skip


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with grasped/pretrain-v1, embed-means-v1, compose-v1 and transfer-eval-v1."""
    folder = tmp_path_factory.mktemp("blocks") / "artifacts"
    settings = tuple(word for setting in TINY for word in ("--set", setting))
    made("--store", folder, "pretrain", "blocks", "--name", "grasped", *settings)
    made("--store", folder, "embed-means", "grasped/pretrain")
    made("--store", folder, "compose", "grasped/embed-means", "--method", "search", "--goal", "0.55,0.1,0.02")
    made("--store", folder, "transfer-eval", "grasped/compose", "--domain", "real-like", "--episodes", "2")
    return folder


def test_artifacts_are_whole_and_hold_the_fingers(store: Path) -> None:
    kept = Store(store)
    for stage in ("pretrain", "embed-means", "compose", "transfer-eval"):
        artifact = kept.read(ArtifactId("grasped", stage, 1))
        assert kept.verify(artifact.id) == []
        arrays = artifact.group("trajectories")
        assert arrays["action"].shape[2] == 8
        assert arrays["finger_position"].shape == (*arrays["joint_position"].shape[:2], 2)


def test_carries_are_evaluated_with_the_block_in_the_hand_and_plans_begin_with_an_open_one(store: Path) -> None:
    kept = Store(store)
    skills = kept.read(ArtifactId("grasped", "pretrain", 1)).group("trajectories")["finger_position"][:, 0].sum(axis=1)
    np.testing.assert_allclose(skills, np.repeat([0.08, 0.08, *[0.04] * 9], 2), atol=1e-3)
    plan = kept.read(ArtifactId("grasped", "compose", 1)).group("trajectories")["finger_position"][:, 0].sum(axis=1)
    np.testing.assert_allclose(plan, 0.08, atol=1e-3)


@pytest.mark.parametrize("words", [("export", "grasped/compose", "--onnx", "p.onnx"), ("execute", "grasped/compose", "--yes")])
def test_what_commands_joints_only_refuses_a_hand_with_one_line(store: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    wanted = [str(tmp_path / word) if word == "p.onnx" else word for word in words]
    result = skill("--store", store, *wanted)
    assert result.code != 0 and "moves the fingers of a hand" in result.err, result.err


def test_a_named_composition_brings_its_scene_and_a_plan_keeps_it(store: Path) -> None:
    made("--store", store, "compose", "grasped/embed-means", "--method", "search", "--task", "stack", "--name", "stacked")
    made("--store", store, "transfer-eval", "stacked/compose", "--domain", "nominal", "--episodes", "2")
    kept = Store(store)
    plan = kept.read(ArtifactId("stacked", "compose", 1))
    assert plan.recipe["task"]["others"] == [[0.45, 0.1], [0.55, -0.1]]
    np.testing.assert_allclose(plan.arrays["waypoints/target"], [[0.45, 0.1, 0.06], [0.55, -0.1, 0.06]])
    library = open_library(kept, plan)
    assert library.world.task.others == ((0.45, 0.1), (0.55, -0.1)), "also for whoever goes on from the plan"
    assert kept.read(plan.parents[0].id).recipe["task"]["others"] == [[0.5, 0.25]]
    for stage in ("compose", "transfer-eval"):
        assert kept.verify(ArtifactId("stacked", stage, 1)) == []


def test_a_tower_is_planned_block_by_block_and_recordings_hold_all_blocks(store: Path, tmp_path: Path) -> None:
    made("--store", store, "compose", "grasped/embed-means", "--method", "search", "--task", "tower", "--name", "built")
    short = ("--set", "transfer.replan_seconds=0.5", "--set", "transfer.replan_budget=1")
    made("--store", store, "transfer-eval", "built/compose", "--domain", "real-like", "--episodes", "1", "--replan", *short)
    kept = Store(store)
    plan = kept.read(ArtifactId("built", "compose", 1))
    assert len(plan.arrays["waypoints/target"]) == 2 and (plan.arrays["plan/route"] == 0).all()
    assert plan.results["expanded_nodes"] == 2, "the budget is for each block"
    others = plan.arrays["trajectories/other_poses"]
    np.testing.assert_allclose(others[:, 0].reshape(-1, 2, 7)[:, :, :2], [[[0.45, -0.1], [0.55, 0.1]]], atol=2e-3)
    for stage in ("compose", "transfer-eval"):
        assert kept.verify(ArtifactId("built", stage, 1)) == []
    made("--store", store, "viz", "built/compose", "-o", tmp_path / "x.rrd", "--png", tmp_path / "x.png")


def test_another_success_radius_judges_the_same_plan(store: Path) -> None:
    rates = []
    for number, radius in enumerate(("1e-4", "5.0"), 1):
        words = ("transfer-eval", "grasped/compose", "--name", "judged", "--episodes", "2", "--domain", "nominal")
        rates.append(made("--store", store, *words, "--set", f"task.tolerance={radius}")["domains"][0]["success_rate"])
        assert Store(store).verify(ArtifactId("judged", "transfer-eval", number)) == []
    assert rates == [0.0, 1.0]
    result = skill("--store", store, "transfer-eval", "grasped/compose", "--set", "task.horizon=7")
    assert result.code == 2 and "task.tolerance" in result.err


def test_the_scene_can_be_set_and_other_keys_of_the_task_cannot(store: Path) -> None:
    words = ("--store", store, "compose", "grasped/embed-means", "--goal", "0.55,0.1,0.06", "--name", "set")
    made(*words, "--set", "task.others=[[0.55, 0.1]]")
    assert Store(store).read(ArtifactId("set", "compose", 1)).recipe["task"]["others"] == [[0.55, 0.1]]
    result = skill(*words, "--set", "task.others=[[9, 9]]")
    assert result.code == 2 and "a block of task.others at (9, 9) starts off the table" in result.err
    for others in ("[[0.53, 0.03]]", "[[0.6, 0.1], [0.6, 0.15]]"):
        result = skill(*words, "--set", f"task.others={others}")
        assert result.code == 2 and "may overlap with another one" in result.err
    result = skill(*words, "--set", "task.block_mass=0.2")
    assert result.code == 2 and "were trained on another recipe" in result.err
    result = skill("--store", store, "transfer-eval", "set/compose", "--set", "task.others=[[0.45, 0.1]]")
    assert result.code == 2 and "another recipe" in result.err, "a plan is sent in the scene that it was made for"
