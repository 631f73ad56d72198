"""`import skillcli`: what it loads, what a library offers, and that the command line does the same."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import TINY, made

import skillcli
from skillcli import ComposedPlan, SkillLibrary, StoreError, UsageError
from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.trajectories import AXES

pytestmark = pytest.mark.slow  # plans and rollouts

REFERENCE = Path(skillcli.__file__).parents[1] / "artifacts"


@pytest.fixture(scope="module")
def reach() -> SkillLibrary:
    return skillcli.load("reference-reach/embed-means", REFERENCE)


def test_names_load_neither_torch_nor_the_engine_and_quickly() -> None:
    code = (
        "import json, sys, time\nbegan = time.process_time()\n"
        f"from skillcli import {', '.join(skillcli.__all__)}\n"
        "heavy = {'torch', 'mujoco', 'rerun', 'gymnasium', 'xarray', 'matplotlib'} & set(sys.modules)\n"
        "print(json.dumps([time.process_time() - began, sorted(heavy)]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    seconds, heavy = json.loads(done.stdout)
    assert heavy == [] and seconds < 0.5  # CPU of a busy machine; alone it is 0.3


def test_a_name_that_is_not_there_is_refused_with_those_that_are() -> None:
    assert len(skillcli.__all__) <= 13 and set(skillcli.__all__) <= set(dir(skillcli))
    with pytest.raises(AttributeError, match=r"it has .*SkillLibrary"):
        skillcli.Skills  # noqa: B018


def test_a_library_has_the_skills_of_its_recipe(reach: SkillLibrary) -> None:
    assert len(reach.skills) == 8 and [skill.name for skill in reach.skills] == [str(k + 1) for k in range(8)]
    mean, std = reach.embed()
    assert mean.shape == std.shape == (8, 3) and (std > 0).all()
    assert np.array_equal(reach.embed("3")[0], mean[2]) and np.array_equal(reach.embed(2)[0], reach.skills[2].mean)
    assert reach.skills[2].goal == pytest.approx((0.5, 0.3, 0.3))
    assert reach.observation == {"joint_position": (7, "rad"), "gripper_position": (3, "m")}
    assert len(reach.joints) == 7 and reach.control_period == 0.05 and reach.action_scale == 0.04
    assert repr(reach) == "SkillLibrary('reference-reach/embed-means-v1', 8 skills of the reach task)"


def test_actions_of_one_and_of_many_are_the_same(reach: SkillLibrary) -> None:
    observation, latent = np.random.default_rng(0).normal(size=(5, 10)), reach.embed()[0][1]
    many = reach.act(observation, latent)
    assert many.shape == (5, 7)
    assert reach.act(observation[3], latent) == pytest.approx(many[3], abs=1e-5)
    assert reach.act(observation, np.tile(latent, (5, 1))) == pytest.approx(many)


@pytest.mark.parametrize(
    ("observation", "latent", "said"),
    [
        (np.zeros(9), np.zeros(3), r"observation: expected the shape \(10,\) or \(N, 10\), got \(9,\)"),
        (np.zeros((2, 10)), np.zeros((3, 3)), "2 observations and 3 latents"),
        (np.full(10, np.nan), np.zeros(3), "observation: a number is not finite"),
        (np.zeros(10), "3", "latent: expected"),
    ],
)
def test_wrong_numbers_are_refused(reach: SkillLibrary, observation: object, latent: object, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        reach.act(observation, latent)  # type: ignore[arg-type]


def test_a_skill_is_rolled_out_as_the_store_has_it(reach: SkillLibrary) -> None:
    stored = reach.artifact.group("trajectories")["gripper_position"][2]
    by_name, by_latent = reach.rollout("3"), reach.rollout(reach.embed("3")[0])
    assert by_name.gripper_position is not None and by_name.gripper_position[0] == pytest.approx(stored, abs=1e-6)
    assert np.array_equal(by_latent.target, by_name.target) and by_latent.success.all() and (by_latent.skill == 2).all()
    assert not reach.rollout("3", goal=(0.7, -0.3, 0.15)).success.any()


def test_episodes_on_robots_of_a_domain_differ_and_repeat(reach: SkillLibrary) -> None:
    first, again = (reach.rollout("3", domain="real-like", episodes=3, seed=1) for _ in range(2))
    ends = first.achieved_goal[:, -1]
    assert first.episodes == 3 and len(np.unique(ends.round(6), axis=0)) == 3
    assert np.array_equal(first.achieved_goal, again.achieved_goal)


@pytest.fixture(scope="module")
def plan(reach: SkillLibrary) -> ComposedPlan:
    return reach.plan((0.6, 0.0, 0.2), settings=["search.budget=200"])


def test_a_plan_meets_its_goal_and_rolls_out_alike(reach: SkillLibrary, plan: ComposedPlan) -> None:
    assert plan.success and plan.final_distance_m <= 0.05
    assert plan.latent.shape == (len(plan.segments), 3) and plan.seconds.sum() == pytest.approx(plan.results.plan_seconds)
    again = reach.rollout(plan)
    assert again.achieved_goal == pytest.approx(plan.trajectories.achieved_goal, abs=1e-6)
    assert reach.rollout(plan, domain="mild", episodes=4).episodes == 4


def test_a_plan_is_not_stored_until_it_is_saved_and_then_as_the_command_stores_it(
    plan: ComposedPlan, reach: SkillLibrary, tmp_path: Path
) -> None:
    for name in ("pretrain-v1", "embed-means-v1"):
        target = tmp_path / "reference-reach" / f"{name}.h5"
        target.parent.mkdir(exist_ok=True)
        target.write_bytes((REFERENCE / "reference-reach" / f"{name}.h5").read_bytes())
    words = ("compose", "reference-reach/embed-means", "--goal", "0.6,0.0,0.2", "--set", "search.budget=200", "--name", "typed")
    typed = made("--store", tmp_path, *words)
    library = skillcli.load("reference-reach/embed-means", tmp_path)
    saved = library.plan((0.6, 0.0, 0.2), settings=["search.budget=200"]).save("programmed")
    assert saved == "programmed/compose-v1"
    hashes = {made("--store", tmp_path, "show", one)["content_sha256"] for one in (typed["id"], saved)}
    assert len(hashes) == 1
    with pytest.raises(UsageError, match="was made with"):
        library.rollout(plan)
    evaluated = skillcli.evaluate(saved, ["mild"], episodes=2, store=tmp_path)
    assert evaluated.id == "programmed/transfer-eval-v1" and evaluated.trajectories.episodes == 2
    assert evaluated.success_rate.keys() == {"mild"}


def test_training_is_that_of_the_command(tmp_path: Path) -> None:
    trained = skillcli.train("smoke", settings=TINY, name="programmed", store=tmp_path)
    typed = made("--store", tmp_path, "pretrain", "smoke", "--name", "typed", *(w for one in TINY for w in ("--set", one)))
    assert made("--store", tmp_path, "show", typed["id"])["content_sha256"] == trained.artifact.content_sha256
    assert trained.artifact.command.startswith("skillcli.train('smoke', settings=[")


@pytest.mark.parametrize("goal", [(0.6, 0.0), ((0.6, 0.0, 0.2), (9.0, 0.0, 0.2)), "rhombus", "x,y", [[[0.6, 0.0, 0.2]]]])
def test_goals_that_make_no_sense_are_refused(reach: SkillLibrary, goal: object) -> None:
    with pytest.raises(UsageError):
        reach.plan(goal)  # type: ignore[arg-type]


def test_a_store_or_an_artifact_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="there is no store"):
        skillcli.load("reference-reach/embed-means", tmp_path / "none")
    with pytest.raises(StoreError):
        skillcli.load("nothing/embed-means", REFERENCE)
    with pytest.raises(UsageError, match="no skill 'left'"):
        skillcli.load("reference-reach/embed-means", REFERENCE).embed("left")


def test_trajectories_become_a_dataset_with_units(reach: SkillLibrary) -> None:
    xarray = pytest.importorskip("xarray")
    recording = reach.rollout("3")
    data = recording.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert data.gripper_position.dims == ("episode", "time", "xyz") and data.gripper_position.attrs["units"] == "m"
    assert data.action.dims == ("episode", "step", "action_axis") and data.step.size == data.time.size - 1
    assert np.array_equal(data.gripper_position.sel(xyz="z", episode=0).values, recording.achieved_goal[0, :, 2])
    assert float(data.time[1]) == pytest.approx(0.05) and {*data} | {"time"} == recording.arrays().keys()


def test_every_field_of_a_recording_is_stored_with_its_axes() -> None:
    assert {path.removeprefix("trajectories/") for path in TRAJECTORIES} == AXES.keys()
    assert AXES.keys() == skillcli.Trajectories.__dataclass_fields__.keys()
