"""The runner of docs/export.md, which needs NumPy alone, plays an exported policy as the library does."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from command import TINY_SET, made
from test_docs import block_with

from skillcli import metrics
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.library import open_library
from skillcli.execution.policy_file import export_policy
from skillcli.store import ArtifactId, Store

pytestmark = pytest.mark.slow  # whole plans are played

ROOT = Path(__file__).parents[2]
REFERENCES = Store(ROOT / "artifacts")


@pytest.fixture
def numpy_policy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The runner as a module, which imports neither ONNX nor torch."""
    module = ModuleType("numpy_policy")
    code = block_with("export.md", "class Policy")
    assert {line.split()[1] for line in code.splitlines() if line.startswith(("import", "from"))} == {
        "json",
        "pathlib",
        "numpy",
    }
    exec(code, vars(module))
    monkeypatch.setitem(sys.modules, "numpy_policy", module)
    return module


@pytest.mark.parametrize(
    ("source", "skill", "near"),
    [
        (ArtifactId("reference-reach", "pretrain", 1), 2, 1e-5),
        (ArtifactId("reference-reach-ur5e", "embed-means", 1), 5, 1e-5),
        (ArtifactId("reference-push-robust", "pretrain", 1), 0, 1e-3),  # a touch magnifies what rounding leaves
    ],
    ids=str,
)
def test_one_skill_ends_where_it_ends_in_the_library(
    source: ArtifactId, skill: int, near: float, numpy_policy: Any, tmp_path: Path
) -> None:
    library = open_library(REFERENCES, REFERENCES.read(source))
    policy = numpy_policy.Policy(export_policy(REFERENCES, source, tmp_path / "policy.onnx").path)
    target, index = library.goals[[skill]], np.array([skill])
    recording, _ = rollout_held(library.world, library.agent, library.mean[[skill]], target, index)

    env: Any = library.world.make_env(1)
    latent = policy.metadata["latents"][library.names[skill]]
    commanded = np.array([joint["start_rad"] for joint in policy.metadata["joints"]])
    for _ in range(policy.metadata["task"]["horizon_steps"]):
        new = policy.target(env.observe()[0], latent, commanded)
        env.step((new - commanded)[None] / policy.metadata["action"]["limit"])
        commanded = new
        assert commanded == pytest.approx(env.arms.commanded[0], abs=1e-5)
    distance = float(np.linalg.norm(env.achieved_goal()[0] - target[0]))
    assert distance == pytest.approx(float(metrics.final_distance(recording)[0]), abs=near) and distance < 0.02


def test_the_loop_that_is_shown_plays_the_plan(
    numpy_policy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    composed = ArtifactId("reference-reach", "compose", 1)
    export_policy(REFERENCES, composed, tmp_path / "policy.onnx")
    monkeypatch.chdir(tmp_path)
    exec(block_with("export.md", "from numpy_policy import"), {})
    assert float(capsys.readouterr().out) == pytest.approx(REFERENCES.read(composed).results["final_distance_m"], abs=1e-5)


def test_a_blend_gives_the_latents_of_the_plan(numpy_policy: Any, tmp_path: Path) -> None:
    blended = ArtifactId("reference-reach", "compose", 2)
    policy = numpy_policy.Policy(export_policy(REFERENCES, blended, tmp_path / "policy.onnx").path)
    (route,) = policy.metadata["plan"]["routes"]
    assert any(segment["latent_end"] for segment in route["segments"])
    recorded = REFERENCES.read(blended).arrays["trajectories/latent"][0]
    assert np.array(list(numpy_policy.latents(route["segments"]))) == pytest.approx(recorded, abs=1e-6)


def test_a_policy_that_is_affine_in_the_latent_is_played_alike(numpy_policy: Any, tmp_path: Path) -> None:
    made("--store", tmp_path, "pretrain", "reach", "--name", "affine", *TINY_SET, "--set", "network.linear_latent=true")
    store, source = Store(tmp_path), ArtifactId("affine", "pretrain", 1)
    policy = numpy_policy.Policy(export_policy(store, source, tmp_path / "policy.onnx").path)
    library, rng = open_library(store, store.read(source)), np.random.default_rng(2)
    observation, latent = np.array(policy.metadata["start"]["observation"]), rng.uniform(-1, 1, 3)
    action = library.agent.act(observation[None], latent[None])[0]
    assert policy.increment(observation, latent) == pytest.approx(np.clip(0.04 * action, -0.04, 0.04), abs=1e-7)
    assert policy.metadata["network"]["latent"] == "affine" and np.abs(action).max() > 1e-4
