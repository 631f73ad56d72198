"""`skill pretrain`: the same run twice, interrupted and resumed, on any number of threads."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command import TELLING, TINY_SET, files, made, skill

from skillcli.learning.learner import Learner
from skillcli.store import load_checkpoint, save_checkpoint

pytestmark = pytest.mark.slow

SMALL = ("pretrain", "smoke", *TINY_SET, "--set", "training.iterations=5")


def content(store: Path, name: str) -> str:
    return str(made("--store", store, "show", f"{name}/pretrain-v1")["content_sha256"])


def interrupt_after(monkeypatch: pytest.MonkeyPatch, iterations: int) -> None:
    """Press Ctrl-C in the middle of an iteration."""
    iterate = Learner.iterate

    def pressed(self: Learner) -> Any:
        if self.iteration == iterations - 1:
            signal.raise_signal(signal.SIGINT)
        return iterate(self)

    monkeypatch.setattr(Learner, "iterate", pressed)


def test_the_same_recipe_and_seed_give_the_same_content_on_any_number_of_threads(tmp_path: Path) -> None:
    one = made("--store", tmp_path, *SMALL, "--name", "one", "--threads", "1")
    two = made("--store", tmp_path, *SMALL, "--name", "two", "--threads", "2")
    other = made("--store", tmp_path, *SMALL, "--name", "other", "--seed", "1")
    assert one["id"] == "one/pretrain-v1" and one["skills"] == two["skills"] != other["skills"]
    assert content(tmp_path, "one") == content(tmp_path, "two") != content(tmp_path, "other")


def test_an_interrupted_training_goes_on_to_the_same_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made("--store", tmp_path, *SMALL, "--name", "whole")
    with monkeypatch.context() as patch:
        interrupt_after(patch, 3)
        result = skill("--store", tmp_path, "--json", *SMALL, "--name", "halves")
    assert result.code == 130, result
    error = result.json["error"]
    assert error["type"] == "Interrupted" and "after iteration 3 of 5" in error["message"] and "--resume" in error["hint"]
    (checkpoint,) = (name for name in files(tmp_path) if name.startswith("halves/"))
    assert ".checkpoint-pretrain" in checkpoint

    made("--store", tmp_path, *SMALL, "--name", "halves", "--resume")
    assert content(tmp_path, "halves") == content(tmp_path, "whole")
    assert not any("checkpoint" in name for name in files(tmp_path))


@pytest.mark.parametrize(("saved", "killed"), [(1, 2), (2, 5)])
def test_a_killed_training_goes_on_from_its_last_checkpoint_to_the_same_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, saved: int, killed: int
) -> None:
    """As kill -9 leaves it: nothing is saved or cleaned up at the end, and some iterations are lost."""
    made("--store", tmp_path, *SMALL, "--name", "whole")
    iterate = Learner.iterate

    def until_killed(self: Learner) -> Any:
        monkeypatch.setattr("skillcli.stages.pretrain.CHECKPOINT_SECONDS", 0.0 if self.iteration < saved else 1e9)
        if self.iteration == killed - 1:
            raise GeneratorExit  # passes all that handles errors and interrupts
        return iterate(self)

    with monkeypatch.context() as patch:
        patch.setattr(Learner, "iterate", until_killed)
        with pytest.raises(GeneratorExit):
            skill("--store", tmp_path, *SMALL, "--name", "halves")
    assert not (tmp_path / "halves" / "pretrain-v1.h5").exists()
    resumed = skill("--store", tmp_path, *SMALL, "--name", "halves", "--resume")
    assert resumed.code == 0, resumed.err
    assert content(tmp_path, "halves") == content(tmp_path, "whole")


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the checkpoint of three iterations of five; tests must not change it."""
    folder = tmp_path_factory.mktemp("interrupted")
    with pytest.MonkeyPatch.context() as patch:
        interrupt_after(patch, 3)
        assert skill("--store", folder, *SMALL).code == 130
    return folder


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"iteration": 10**9}, "iteration must be between 1 and 5"),
        ({"iteration": -5}, "iteration must be between 1 and 5"),
        ({"wall_seconds": "long"}, "wall_seconds must be a duration, got 'long'"),
        ({"inputs_sha256": "0" * 64}, "it was made from another recipe or seed"),
        ({"generator": "garbage"}, "generator is not the state of one"),
        ({"pool": [10**6, 0]}, "pool cannot have 1000000 states"),
    ],
)
def test_a_checkpoint_that_is_none_is_refused_in_one_line_and_stays(
    interrupted: Path, tmp_path: Path, change: dict[str, Any], told: str
) -> None:
    store = shutil.copytree(interrupted, tmp_path / "store")
    (path,) = store.glob("smoke/.checkpoint-pretrain-*.h5")
    arrays, state = load_checkpoint(path)
    save_checkpoint(path, arrays, {**state, **change})
    for command in (SMALL, ("run", *SMALL[1:])):
        refused = skill("--store", store, "--json", *command, *(("--resume",) if command is SMALL else ()))
        error = refused.json["error"]
        assert refused.code == 1 and error["type"] == "StoreError", refused
        assert f"the checkpoint {path} is not one of this training: {told}" in error["message"]
        assert "\n" not in error["message"] and "remove it, or start anew" in error["hint"]
    assert path.exists(), "it is the user's"


def test_without_resume_a_checkpoint_does_not_matter(interrupted: Path, tmp_path: Path) -> None:
    store = shutil.copytree(interrupted, tmp_path / "store")
    (path,) = store.glob("smoke/.checkpoint-pretrain-*.h5")
    path.write_bytes(b"garbage")
    assert skill("--store", store, *SMALL, "--resume").code == 1
    assert made("--store", store, *SMALL)["id"] == "smoke/pretrain-v1"
    assert not path.exists()


def test_ctrl_c_after_the_training_does_not_lose_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("skillcli.stages.pretrain.evaluate", pressed)
        assert skill("--store", tmp_path, *SMALL).code == 130
    assert any("checkpoint" in name for name in files(tmp_path))


def test_resume_without_a_checkpoint_starts_anew(tmp_path: Path) -> None:
    assert made("--store", tmp_path, *SMALL, "--resume")["id"] == "smoke/pretrain-v1"


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_training_that_comes_apart_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    result = skill(
        "--store", tmp_path, "--json", *SMALL, "--set", "training.reward_scale=1e12", "--set", "training.value_scale=1e-12"
    )
    assert result.code == 1
    error = result.json["error"]
    assert "diverged" in error["message"] and "learning_rate" in error["hint"]
    assert files(tmp_path) == set()


def test_a_real_ctrl_c_stops_a_real_process_and_keeps_its_state(tmp_path: Path) -> None:
    words = ["--store", tmp_path, "--json", "pretrain", "point", "--set", "training.iterations=100000"]
    command = [sys.executable, "-c", TELLING, *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == "iterating\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert '"Interrupted"' in out and "the state is saved" in err and "Traceback" not in err
    assert [".checkpoint-pretrain" in name for name in files(tmp_path)] == [True]
