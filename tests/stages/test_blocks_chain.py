"""A library that grasps goes through the stages like any other, as far as drivers and exported policies are not asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import made, skill

from skillcli.store import ArtifactId, Store

pytestmark = pytest.mark.slow

TINY = (
    "training.iterations=1", "training.simulations=14", "training.minibatch=128", "task.horizon=6", "evaluation.latents=1",
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
    np.testing.assert_allclose(skills, np.repeat([0.08, 0.08, 0.04, 0.04, 0.04, 0.04, 0.04], 2), atol=1e-3)
    plan = kept.read(ArtifactId("grasped", "compose", 1)).group("trajectories")["finger_position"][:, 0].sum(axis=1)
    np.testing.assert_allclose(plan, 0.08, atol=1e-3)


@pytest.mark.parametrize("words", [("export", "grasped/compose", "--onnx", "p.onnx"), ("execute", "grasped/compose", "--yes")])
def test_what_commands_joints_only_refuses_a_hand_with_one_line(store: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    wanted = [str(tmp_path / word) if word == "p.onnx" else word for word in words]
    result = skill("--store", store, *wanted)
    assert result.code != 0 and "moves the fingers of a hand" in result.err, result.err
