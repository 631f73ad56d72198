"""A task in a file of a user, as docs/add-a-task.md shows it: trained, composed, transferred, drawn and reported."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command import made, skill
from worlds import SAWYER, target_robot, world

from skillcli.errors import UsageError
from skillcli.recipe import load_recipe, resolve
from skillcli.store import Store
from skillcli.tasks import registry
from skillcli.tasks.world import World

pytestmark = pytest.mark.slow  # trains

ROOT = Path(__file__).parents[2]
SERVO = ROOT / "tests" / "robots" / "servo.toml"
SMALL = ["training.iterations=2", "training.simulations=8", "task.horizon=8", "evaluation.latents=2", "evaluation.stored=1"]


def block_with(text: str) -> str:
    """The indented block of the page that has this in it."""
    blocks, block = [], ""
    for line in (ROOT / "docs" / "add-a-task.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("    ") or (block and not line):
            block += line[4:] + "\n"
        elif block:
            blocks, block = [*blocks, block], ""
    return next(each for each in blocks if text in each)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The files of the page."""
    place = tmp_path_factory.mktemp("own")
    (place / "planar.py").write_text(block_with("class PlanarTask"), encoding="utf-8")
    (place / "planar.toml").write_text(block_with('extends = "reach"'), encoding="utf-8")
    yield place
    registry._OF_USERS.clear()


@pytest.fixture(scope="module")
def store(folder: Path) -> Path:
    """Everything that is made of it."""
    place = folder / "artifacts"
    settings = [word for setting in SMALL for word in ("--set", setting)]
    made("--store", place, "pretrain", str(folder / "planar.toml"), *settings)
    made("--store", place, "embed-means")
    made("--store", place, "compose", "--goal", "0.6,0.1", "--set", "search.budget=3")
    made("--store", place, "transfer-eval", "--domain", "mild", "--episodes", "2", "--robot", str(SERVO))
    return place


def test_the_reward_is_the_one_that_is_shown(folder: Path) -> None:
    recipe = load_recipe(str(folder / "planar.toml"))
    env = World.of(recipe).make_env(2, 1)
    env.desired_goal[:] = env.achieved_goal()
    env.desired_goal[1, 2] += 0.1  # ten centimetres above it: counted once as distance and twice as height
    reward = env.step(np.zeros((2, env.action_size))).reward
    assert reward[0] == pytest.approx(0, abs=0.01) and reward[0] - reward[1] == pytest.approx(0.3, abs=0.01)


def test_it_plays_on_another_robot(folder: Path) -> None:
    task = load_recipe(str(folder / "planar.toml")).task
    own, other = world(task).make_env(2, 1), world(task, target_robot(SERVO)).make_env(2, 1)
    assert other.robot is not SAWYER and own.robot is SAWYER
    assert world(task).place_goal((0.5, 0.2)) == [0.5, 0.2, 0.25]


def test_skills_plans_and_transfers_say_which_file_they_are_of(store: Path) -> None:
    kept = Store(store)
    for stage in ("pretrain", "embed-means", "compose", "transfer-eval"):
        task = kept.read(kept.resolve(f"planar/{stage}")).recipe["task"]
        assert task["name"] == "planar" and task["module"].endswith("planar.py") and len(task["source_sha256"]) == 64
    assert kept.read(kept.resolve("planar/transfer-eval")).results["robot"]["file"] == "servo.toml"


def test_it_is_drawn_reported_and_verified(store: Path, tmp_path: Path) -> None:
    for stage in ("pretrain", "compose", "transfer-eval"):
        found = made(
            "--store", store, "viz", f"planar/{stage}", "-o", tmp_path / f"{stage}.rrd", "--png", tmp_path / f"{stage}.png"
        )
        assert Path(found["png"]).stat().st_size > 10_000
    assert Path(made("--store", store, "report", "-o", tmp_path / "report")["html"]).is_file()
    assert skill("--store", store, "verify", "--all").code == 0


def test_a_changed_file_is_not_taken_for_the_one_of_the_skills(store: Path, folder: Path) -> None:
    source = folder / "planar.py"
    before = source.read_text(encoding="utf-8")
    source.write_text(before.replace("OFF_PLANE = 2.0", "OFF_PLANE = 3.0"), encoding="utf-8")
    try:
        told = skill("--store", store, "compose", "planar/embed-means", "--goal", "0.6,0.1")
        assert told.code != 0 and "is not the file that these skills were trained on" in told.err, told
    finally:
        source.write_text(before, encoding="utf-8")


def test_an_artifact_alone_does_not_run_a_file(store: Path, folder: Path, tmp_path: Path) -> None:
    marked = folder / "planar.py"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    code = (
        "import sys; from skillcli.cli.main import main\n"
        f"sys.argv = ['skill', '--store', {str(store)!r}, 'compose', 'planar/embed-means', '--goal', '0.6,0.1']\nmain()"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode != 0 and "never ran here" in done.stderr and marked.is_file(), done.stderr


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("TASK = 3", "holds no task: TASK has to be a TaskSpec"),
        ("1 / 0", "fails: ZeroDivisionError"),
        ("from skillcli.tasks.reach.task import TASK", "there is a task 'reach' already"),
        (None, "cannot be read"),
    ],
)
def test_a_file_that_holds_no_task_is_refused(tmp_path: Path, source: str | None, said: str) -> None:
    path = tmp_path / "mine.py"
    if source is not None:
        path.write_text(source, encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        resolve({"name": "r", "task": {"module": str(path)}}, by_hand=True)


def test_a_stored_recipe_that_leaves_the_hash_out_runs_nothing_either(tmp_path: Path) -> None:
    path, mark = tmp_path / "mine.py", tmp_path / "ran"
    path.write_text(f"open({str(mark)!r}, 'w').close()", encoding="utf-8")
    with pytest.raises(UsageError, match="never ran here"):
        resolve({"name": "r", "task": {"module": str(path)}})
    assert not mark.exists()
