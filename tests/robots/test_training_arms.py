"""ArmBatch that skills are trained on: read from a file, of any number of joints from four to eight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import made, skill

from skillcli.errors import UsageError
from skillcli.recipe import resolve
from skillcli.robots.robot import load_robot
from skillcli.store import Store
from skillcli.tasks.world import World

pytestmark = pytest.mark.slow  # trains

ROBOTS = Path(__file__).parent
SIX = ["base_yaw", "shoulder", "upper_roll", "elbow", "fore_roll", "wrist"]
START = [-0.28, -1.24, 0.01, 1.65, 0.0, 1.16]


@pytest.fixture
def six(tmp_path: Path) -> Path:
    """An arm of six joints, its hand at rest."""
    (tmp_path / "torque.xml").write_text((ROBOTS / "torque.xml").read_text(encoding="utf-8"), encoding="utf-8")
    path = tmp_path / "six.toml"
    path.write_text(
        f"""model = "torque.xml"
joints = {SIX}
start = {START}
speed_limit = [2, 2, 2, 2, 3, 3]
[gripper]
site = "mount"
[gains]
kp = [900, 900, 700, 700, 400, 400]
kv = [90, 90, 70, 70, 40, 40]
""",
        encoding="utf-8",
    )
    return path


def test_an_arm_has_what_its_file_says(six: Path) -> None:
    robot = load_robot(six)
    assert robot.joint_count == 6 and robot.home == tuple(START) and robot.start("push") == robot.home
    assert robot.speed_limit.tolist() == [2, 2, 2, 2, 3, 3] and robot.description.joints == tuple(SIX)
    assert 0.8 < robot.workspace.reach < 1.6, "the sum of the links with our finger"


def test_a_bundled_robot_is_found_by_its_name_and_others_by_their_path(six: Path) -> None:
    assert load_robot("sawyer") is load_robot("sawyer")
    for wrong in ("panda9000", str(six.with_name("nothing.toml"))):
        with pytest.raises(UsageError) as caught:
            load_robot(wrong)
        assert caught.value.hint


@pytest.mark.parametrize("task", ["reach", "push"])
def test_tasks_have_the_sizes_of_the_arm(six: Path, task: str) -> None:
    world = World.of(resolve({"name": "six", "robot": str(six), "task": {"name": task}}))
    env = world.make_env(2, 1, delay=True)
    assert (env.action_size, env.joints, env.observation_size) == (6, 6, 9) and world.sizes[:2] == (9, 6)
    gain = np.full((2, 6), 1.2)
    env.randomize({"gain": gain, "joint_noise": np.full(2, 0.01), "latency": np.full(2, 0.05)}, np.random.default_rng(0))
    env.reset(np.arange(2), np.zeros(2, dtype=np.int64))
    for action in np.random.default_rng(1).uniform(-1, 1, (4, 2, 6)):
        step = env.step(action)
    assert np.isfinite(step.observation).all() and not step.terminated.any()


def test_skills_of_six_joints_are_trained_composed_transferred_and_drawn(six: Path, tmp_path: Path) -> None:
    store, recipe = tmp_path / "artifacts", tmp_path / "six-reach.toml"
    recipe.write_text('extends = "smoke"\nname = "six"\nrobot = "six.toml"\n', encoding="utf-8")
    small = ["training.iterations=2", "training.simulations=8", "evaluation.latents=2", "evaluation.stored=1"]
    made("--store", store, "pretrain", str(recipe), *(word for setting in small for word in ("--set", setting)))
    made("--store", store, "embed-means")
    made("--store", store, "compose", "--goal", "0.6,0.1,0.2", "--set", "search.budget=3")
    made("--store", store, "transfer-eval", "--domain", "mild", "--episodes", "2")
    made("--store", store, "viz", "six/compose", "-o", tmp_path / "six.rrd", "--png", tmp_path / "six.png")
    kept = Store(store).read(Store(store).resolve("six/transfer-eval"))
    assert kept.arrays["trajectories/joint_position"].shape[-1] == kept.arrays["trajectories/action"].shape[-1] == 6
    assert kept.arrays["domains/mild/gain"].shape == (2, 6) and kept.recipe["robot"].endswith("six.toml")
    assert made("--store", store, "show", "six/compose")["robot"] == kept.recipe["robot"] == kept.robot
    page = tmp_path / "report.html"
    made("--store", store, "report", "-o", page)
    text = page.read_text(encoding="utf-8")
    assert "On other arms than the paper&#39;s: six (six)." in text and "skill compose ID --method ddpg" in text
    assert "from its own goals" in text and ", on the six" in text
    refused_without_its_robot(six, store)


def refused_without_its_robot(six: Path, store: Path) -> None:
    """Whatever needs the robot that skills were trained on says in one line that its file is gone, or is another one."""
    later = (["embed-means", "six/pretrain"], ["compose", "six/embed-means", "--goal", "0.6,0.1,0.2"], ["viz", "six/compose"])
    later += (["transfer-eval", "six/compose", "--domain", "nominal", "--robot", str(six.with_name("mine.toml"))],)
    text = six.read_text(encoding="utf-8")
    six.rename(six.with_name("mine.toml"))
    for arguments in later:
        result = skill("--store", store, *arguments)
        assert result.code == 1 and "needs the robot file" in result.err and str(six) in result.err, result.err
    six.write_text(text.replace("kp = [900,", "kp = [800,"), encoding="utf-8")
    for arguments in later:
        result = skill("--store", store, *arguments)
        assert result.code == 1 and "six/pretrain-v1 was trained on another robot than" in result.err, result.err
    six.write_text(f"# the same\n{text}".replace("kp = [900, 900", "kp = [900.0, 900"), encoding="utf-8")  # says the same
    made("--store", store, *later[-1], "--episodes", "2")


def test_values_for_other_joints_than_there_are_are_refused(six: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the arm has 6 joints, the start 7 angles"):
        resolve({"name": "six", "robot": str(six), "task": {"name": "reach", "start": [0.0] * 7}})
    six.write_text(six.read_text(encoding="utf-8").replace("[2, 2, 2, 2, 3, 3]", "[2, 2]"), encoding="utf-8")
    with pytest.raises(UsageError, match="speed_limit: expected 6 values, one for each joint, got 2"):
        load_robot(six)
