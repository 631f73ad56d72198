"""An exported policy answers as its library does, says what it is, and is written whole or not at all."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from command import made, skill

from skillcli.errors import SkillError, UsageError
from skillcli.evaluation.library import open_library
from skillcli.execution import parity, policy_graph
from skillcli.execution.policy_file import export_policy
from skillcli.simulation.arms import ArmBatch
from skillcli.store import ArtifactId, Store

pytestmark = pytest.mark.slow  # ONNX files are written and run

ROOT = Path(__file__).parents[2]
REFERENCES = Store(ROOT / "artifacts")
REACH, POINT = ArtifactId("reference-reach", "compose", 1), ArtifactId("reference-point", "pretrain", 1)
ALL = [
    ArtifactId("reference-point", "embed-means", 1),
    ArtifactId("reference-reach", "pretrain", 1),
    ArtifactId("reference-reach", "embed-means", 1),
    ArtifactId("reference-reach", "compose", 2),  # blends from one latent to another
    ArtifactId("reference-push", "compose", 1),  # twelve routes
    ArtifactId("reference-push-robust", "pretrain", 1),  # sees its own commands
    ArtifactId("reference-reach-ur5e", "compose", 1),
]


def metadata_of(path: Path) -> dict[str, Any]:
    return {entry.key: json.loads(entry.value) for entry in onnx.load(path).metadata_props}


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The triangle of the Sawyer, exported."""
    path = tmp_path_factory.mktemp("reach") / "policy.onnx"
    export_policy(REFERENCES, REACH, path)
    return path


@pytest.mark.parametrize("source", ALL, ids=str)
def test_every_reference_library_is_exported_with_parity(source: ArtifactId, tmp_path: Path) -> None:
    written = export_policy(REFERENCES, source, tmp_path / "policy.onnx")
    assert 0 < written.parity.max_abs_error < parity.TOLERANCE and written.parity.observations >= 2000
    assert metadata_of(written.path)["source"]["id"] == str(source)


def test_its_outputs_are_those_of_the_policy_of_the_action_limit_and_of_the_simulation(reach: Path) -> None:
    library = open_library(REFERENCES, REFERENCES.read(REACH))
    limit, rng = library.world.task.action_scale, np.random.default_rng(1)
    env: Any = library.world.make_env(5)
    env.reset(np.arange(5), np.zeros(5, dtype=np.int64))
    session = onnxruntime.InferenceSession(reach)
    for _ in range(20):
        latent = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        observation, commanded = env.observe(), env.arms.commanded.astype(np.float32)
        given = {"observation": observation, "latent": latent, "commanded": commanded}
        action, increment, target = session.run(["action", "increment", "target"], given)
        assert action == pytest.approx(library.agent.act(observation, latent), abs=1e-5)
        assert increment == pytest.approx(np.clip(limit * action, -limit, limit), abs=1e-7)
        env.step(action)
        assert target == pytest.approx(env.arms.commanded, abs=1e-6)
    assert np.abs(increment).max() == pytest.approx(limit)  # it was clipped


def test_what_it_says_about_itself_is_exact(reach: Path) -> None:
    artifact = REFERENCES.read(REACH)
    library, said = open_library(REFERENCES, artifact), metadata_of(reach)
    robot, source = library.world.robot, library.source
    assert said["source"] == {
        "id": "reference-reach/compose-v1",
        "kind": "compose",
        "content_sha256": artifact.content_sha256,
        "library": {"id": "reference-reach/pretrain-v1", "content_sha256": source.content_sha256},
    }
    assert said["robot"]["name"] == "sawyer" and said["robot"]["fingerprint"] == robot.fingerprint
    assert [joint["name"] for joint in said["joints"]] == [f"right_j{k}" for k in range(7)]
    assert [joint["home_rad"] for joint in said["joints"]] == list(robot.home)
    assert [joint["speed_limit_rad_s"] for joint in said["joints"]] == robot.speed_limit.tolist()
    for joint in said["joints"]:
        assert joint["low_rad"] + 0.02 == pytest.approx(joint["lowest_target_rad"], abs=1e-12)
        assert joint["lowest_target_rad"] < joint["start_rad"] < joint["highest_target_rad"] < joint["high_rad"]
    assert said["control_period_s"] == 0.05 and said["action"]["limit"] == 0.04 and said["action"]["unit"] == "rad"
    assert said["action"]["max_tracking_error_rad"] == ArmBatch.MAX_TRACKING_ERROR
    assert {name: tuple(mean) for name, mean in said["latents"].items()} == {
        name: tuple(mean) for name, mean in zip(library.names, library.mean.tolist(), strict=True)
    }
    terms = [(term["name"], term["unit"], term["size"], term["first"], term["last"]) for term in said["observation"]]
    assert terms == [("joint_position", "rad", 7, 0, 6), ("gripper_position", "m", 3, 7, 9)]
    assert all(term["frame"] for term in said["observation"]) and len(said["start"]["observation"]) == 10
    (route,) = said["plan"]["routes"]
    assert [segment["latent"] for segment in route["segments"]] == artifact.arrays["plan/latent"].tolist()
    assert [segment["seconds"] for segment in route["segments"]] == pytest.approx(artifact.arrays["plan/seconds"])
    assert [segment["skill"] for segment in route["segments"]] == [one["skill"] for one in artifact.results["segments"]]
    assert route["waypoints_m"] == artifact.arrays["waypoints/target"].tolist()


def test_inputs_and_outputs_are_described_in_the_file(reach: Path) -> None:
    graph, said = onnx.load(reach).graph, metadata_of(reach)
    assert [port["name"] for port in said["inputs"]] == ["observation", "latent", "commanded"]
    assert [port["name"] for port in said["outputs"]] == ["action", "increment", "target"]
    for value, port in zip((*graph.input, *graph.output), (*said["inputs"], *said["outputs"]), strict=True):
        rows, columns = value.type.tensor_type.shape.dim
        assert value.name == port["name"] and port["unit"] in value.doc_string
        assert [rows.dim_param, columns.dim_value] == port["shape"] == ["N", len(port["order"])]
    assert said["inputs"][0]["order"][6:8] == ["joint_position right_j6", "gripper_position x"]
    assert said["outputs"][2]["order"] == [joint["name"] for joint in said["joints"]]


def test_a_point_has_neither_joints_nor_targets(tmp_path: Path) -> None:
    written = export_policy(REFERENCES, POINT, tmp_path / "point.onnx")
    said = metadata_of(written.path)
    assert [port.name for port in written.inputs] == ["observation", "latent"] and written.robot == ""
    assert [(port.name, port.unit, port.order) for port in written.outputs] == [
        ("action", "0.1 m", ("x", "y")),
        ("increment", "m", ("x", "y")),
    ]
    assert said["robot"] is None and said["joints"] == [] and said["start"]["observation"] == [0.0, 0.0]
    assert said["action"]["limit"] == 0.1 and "plan" not in said and len(said["latents"]) == 4


def test_the_same_artifact_gives_the_same_bytes_wherever_it_is_written(reach: Path, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    again = export_policy(REFERENCES, REACH, tmp_path / "folder" / "other.onnx")
    assert again.path.read_bytes() == reach.read_bytes()
    assert [path.name for path in again.path.parent.iterdir()] == ["other.onnx"]


def test_the_command_says_what_it_wrote(tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    found = made("--store", REFERENCES.root, "export", str(POINT), "--onnx", path)
    assert found["onnx"] == str(path) and found["bytes"] == path.stat().st_size
    assert found["parity"].keys() == {"max_abs_error", "observations"} and found["parity"]["observations"] >= 2000
    assert found["inputs"][0] == {
        "name": "observation",
        "type": "float32",
        "shape": ["N", 2],
        "unit": "m",
        "order": ["position x", "position y"],
        "meaning": "raw, as measured: the normaliser is inside",
    }
    assert [port["name"] for port in found["outputs"]] == ["action", "increment"]
    told = skill("--store", REFERENCES.root, "export", str(POINT), "--onnx", tmp_path / "again.onnx")
    assert told.code == 0 and "observation" in told.out and "ONNX Runtime and torch differ by at most" in told.out


def test_a_transfer_has_no_policy(tmp_path: Path) -> None:
    refused = skill(
        "--json", "--store", REFERENCES.root, "export", "reference-reach/transfer-eval-v1", "--onnx", tmp_path / "x"
    )
    assert refused.code != 0 and "expected an artifact of kind pretrain" in refused.json["error"]["message"]
    with pytest.raises(UsageError, match="no policy to export"):
        export_policy(REFERENCES, ArtifactId("reference-reach", "transfer-eval", 1), tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_an_archive_and_a_policy_are_not_written_at_once(tmp_path: Path) -> None:
    words = ("export", str(POINT), "--onnx", tmp_path / "x.onnx", "-o", tmp_path / "x.tar")
    refused = skill("--json", "--store", REFERENCES.root, *words)
    assert refused.code == 2 and "different files" in refused.json["error"]["message"] and list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_is_replaced_as_a_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "policy.onnx"
    path.write_bytes(b"the one before")
    with monkeypatch.context() as patch:
        patch.setattr(parity, "TOLERANCE", -1.0)
        with pytest.raises(SkillError, match="ONNX Runtime and torch differ"):
            export_policy(REFERENCES, POINT, path)
    assert path.read_bytes() == b"the one before" and list(tmp_path.iterdir()) == [path]
    export_policy(REFERENCES, POINT, path)
    assert path.read_bytes() != b"the one before" and list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(parity, "expected", lambda *_: pytest.fail("it worked on"))
    with pytest.raises(SkillError, match="cannot write") as refused:
        export_policy(REFERENCES, POINT, tmp_path / "file" / "policy.onnx")
    assert "--store" not in refused.value.hint
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_named_with_how_to_install_it(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    refused = skill("--json", "--store", REFERENCES.root, "export", str(POINT), "--onnx", tmp_path / "x.onnx")
    assert refused.code == 1 and f"{package} is not installed" in refused.json["error"]["message"]
    assert refused.json["error"]["hint"] == "pip install 'skillcli[onnx]'" and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrong", [2e-5, np.nan])
@pytest.mark.parametrize("output", ["action", "increment"])
def test_a_file_that_answers_otherwise_is_not_written(
    output: str, wrong: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = parity.expected

    def expected(*given: Any) -> dict[str, Any]:
        outputs = {name: np.array(rows) for name, rows in right(*given).items()}
        outputs[output][-1, 0] += wrong  # of one random observation
        return outputs

    monkeypatch.setattr(parity, "expected", expected)
    with pytest.raises(parity.ParityError, match=f"differ in `{output}`"):
        export_policy(REFERENCES, POINT, tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []


def test_random_observations_find_a_clip_that_no_recorded_one_reaches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_graph, "CLIP", 6.0)
    refused = skill("--json", "--store", REFERENCES.root, "export", str(POINT), "--onnx", tmp_path / "policy.onnx")
    assert refused.code == 1 and "ONNX Runtime and torch differ" in refused.json["error"]["message"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("robot", "joints"), [("so101", 5), ("ur5e", 6), ("panda", 7)])
@pytest.mark.parametrize("more", [(), ("network.linear_latent=true", "task.observe_command=true", "network.policy_hidden=[]")])
def test_arms_of_five_six_and_seven_joints_are_exported(robot: str, joints: int, more: tuple[str, ...], tmp_path: Path) -> None:
    hasty = ("training.iterations=1", "training.simulations=16", "training.minibatch=128", "task.horizon=16", *more)
    few = ("evaluation.latents=1", "evaluation.stored=0")
    changed = [word for setting in (*hasty, *few) for word in ("--set", setting)]
    made("--store", tmp_path, "pretrain", "reach", "--robot", robot, "--name", "arm", *changed)
    found = made("--store", tmp_path, "export", "arm/pretrain", "--onnx", tmp_path / "policy.onnx")
    assert found["parity"]["max_abs_error"] < parity.TOLERANCE and found["parity"]["observations"] >= 2000
    assert found["outputs"][2]["shape"] == ["N", joints]
    said = metadata_of(tmp_path / "policy.onnx")
    assert len(said["joints"]) == joints and said["robot"]["name"] == robot
    assert said["network"] == {"layers": 1 if more else 3, "latent": "affine" if more else "input"}
    assert found["inputs"][0]["shape"] == ["N", joints + 3 + (joints if more else 0)]
