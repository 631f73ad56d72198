"""`skill identify` as a user meets it: from a log or an artifact to a domain that other commands take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import made, skill
from execution.logs import NAMES, recorded, wandering

from skillcli.recipe import load_recipe
from skillcli.simulation.domains import PRESETS, find_domain

TRUE_GAIN = [0.75, 1.25, 0.8, 1.2, 0.8, 1.25, 0.8]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of a Sawyer whose servos differ and whose commands come one step late."""
    path = tmp_path_factory.mktemp("logs") / "run.npz"
    recording = recorded({"gain": TRUE_GAIN, "latency": 0.05}, wandering(100), noise=0.002)
    np.savez(path, time=recording.stamps, joint_position=recording.position, target=recording.sent, joint_names=NAMES)
    return path


@pytest.mark.slow
def test_a_log_becomes_a_domain_that_other_commands_take(log: Path, tmp_path: Path) -> None:
    file = tmp_path / "bench-arm.toml"
    found = made("identify", log, "--robot", "sawyer", "-o", file)
    assert found["file"] == str(file) and found["name"] == "bench-arm" and found["kept"]
    prediction = found["prediction"]
    assert prediction["fitted_rad"] < 0.5 * prediction["nominal_rad"] and prediction["heldout_steps"] == 20
    assert {"one_step", "half_second"} <= prediction.keys()
    assert found["parameters"]["latency"] == {
        "value": 0.05,
        "low": pytest.approx(0.05, abs=0.01),
        "high": pytest.approx(0.05, abs=0.01),
    }
    gain = found["parameters"]["gain"]
    np.testing.assert_allclose(gain["value"], TRUE_GAIN, rtol=0.2)
    assert (np.array(gain["low"]) < gain["value"]).all() and (np.array(gain["value"]) < gain["high"]).all()
    domain = find_domain(str(file))
    assert domain.parameters["latency"].values == (0.05,) and domain.parameters["gain"].kind == "between"
    assert "bench-arm" in skill("domains", file).out
    randomisation = load_recipe("reach", [f"randomisation={file}"]).randomisation
    assert randomisation.ranges == domain.parameters and "latency" in randomisation.sensing and "gain" in randomisation.dynamics
    own = load_recipe("reach", [f"randomisation.domain={file}", "randomisation.dynamics.gain=1.5"]).randomisation.ranges
    assert own["gain"].values == (1.5,) and own["latency"] == domain.parameters["latency"]


def test_an_artifact_is_a_log_too_and_one_that_the_simulation_predicts_exactly_stays_nominal(
    chain: Path, tmp_path: Path
) -> None:
    file = tmp_path / "real-like.toml"
    found = made("--store", chain, "identify", "tiny/pretrain-v1", "--robot", "sawyer", "-o", file)
    assert (
        found["prediction"]["fitted_rad"]
        <= found["prediction"]["nominal_rad"]
        < 0.01
        < found["prediction"]["half_second"]["unmoved_rad"]
    )
    assert found["name"] == "fitted-real-like" not in PRESETS and find_domain(str(file)).name == found["name"]
    done = made(
        "--store", chain, "transfer-eval", "tiny/compose-v1", "--domain", file, "--episodes", "2", "--name", "elsewhere"
    )
    assert [domain["name"] for domain in done["domains"]] == ["fitted-real-like"]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("none.csv", "--robot", "sawyer", "-o", "x.toml"), 2, "log none.csv cannot be read: No such file"),
        (("none.csv", "--robot", "sawyer", "-o", "x.json"), 2, "a domain file is TOML, got 'x.json'"),
        (("none.csv", "--robot", "swyer", "-o", "x.toml"), 2, "swyer"),
        (("no/pretrain", "--robot", "sawyer", "-o", "x.toml"), 1, "no/pretrain"),
        (("none.csv", "-o", "x.toml"), 2, "--robot"),
    ],
)
def test_what_cannot_be_identified_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], code: int, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "artifacts").mkdir()
    result = skill("identify", *words)
    assert result.code == code and said in " ".join(result.err.split()), result.err
    assert not list(tmp_path.glob("*.toml"))


def test_a_log_of_another_arm_and_one_without_motion_are_refused(log: Path, tmp_path: Path) -> None:
    result = skill("identify", log, "--robot", "ur5e", "-o", tmp_path / "x.toml")
    assert result.code == 2 and "are not the joints of the robot file" in " ".join(result.err.split())
    still = tmp_path / "still.npz"
    np.savez(still, joint_position=np.zeros((100, 7)), target=np.zeros((100, 7)))
    result = skill("identify", still, "--robot", "sawyer", "-o", tmp_path / "x.toml")
    assert result.code == 2 and "no joint moves by more than 1 mrad" in " ".join(result.err.split())
    assert "every episode begins with all joints at zero: if the angles count from the start, give --relative" in result.err
    result = skill("identify", still, "--robot", "sawyer", "-o", tmp_path / "x.toml", "--relative")
    assert result.code == 2 and "--relative: the log has no gripper positions" in " ".join(result.err.split())
