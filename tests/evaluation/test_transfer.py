"""Transfers: the same robots whatever is judged, reports that follow from the episodes, other robots, and robots that break."""

from __future__ import annotations

import io
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import made, skill
from rich.console import Console
from worlds import target_robot

from skillcli import metrics
from skillcli.cli import tables
from skillcli.config.randomization import MANNERS
from skillcli.errors import UsageError
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.inputs import transfer_eval_inputs
from skillcli.evaluation.library import Library, open_library
from skillcli.evaluation.transfer_evaluator import NOMINAL, TargetRobots, TransferEvaluator
from skillcli.evaluation.transfer_results import count_violations, most_harmful_first, one_at_a_time, outcome, worst
from skillcli.kinds import TRANSFER_EVAL
from skillcli.progress import Progress
from skillcli.recipe import resolve
from skillcli.simulation.domains import find_domain, find_domains
from skillcli.stages.transfer_eval import transfer_eval
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.trajectories import SAFETY_LIMITS, Array, Trajectories
from skillcli.viz import loading
from skillcli.viz.loading import scene_of
from skillcli.viz.recording import record
from skillcli.viz.visualise import draw

SOURCE = ArtifactId("tiny", "compose", 1)
ROBOT = Path(__file__).parent.parent / "robots" / "servo.toml"
MESHES = ROBOT.with_name("meshes.toml")
REPLAN = ["transfer.replan=true", "transfer.replan_seconds=0.2", "transfer.replan_budget=2"]
# Feather-light links, much too stiff late servos, and hard knocks.
NASTY = """name = "nasty"
[parameters]
link_mass = 0.01
link_inertia = 0.01
armature = 0.01
gain = 1000.0
latency = 0.1
joint_noise = 1.0
push_rate = 20.0
arm_push = 50.0
"""


@pytest.fixture
def copy(chain: Path, tmp_path: Path) -> Store:
    """A store of one's own with the tiny chain in it."""
    return Store(shutil.copytree(chain, tmp_path / "artifacts"))


@pytest.fixture
def library(chain: Path) -> Library:
    return open_library(Store(chain), Store(chain).read(SOURCE))


def moved(store: Store, domains: Sequence[str], *settings: str, episodes: int = 3, **more: Any) -> Artifact:
    recipe = resolve(store.read(SOURCE).recipe, settings)
    return transfer_eval(store, SOURCE, recipe, domains, episodes, 0, "test", **more)


def recording(artifact: Artifact) -> Trajectories:
    return Trajectories(**artifact.group("trajectories"))


def shown(artifact: Artifact) -> str:
    console = Console(width=160, file=io.StringIO())
    console.print(tables.transfer(artifact))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def ended(*distance: float, violations: Array | None = None, tolerance: float = 0.05) -> Trajectories:
    """Episodes of one step that end at these distances, m."""
    episodes, end = len(distance), np.array(distance)
    path = np.zeros((episodes, 2, 3))
    path[:, 1, 0] = end
    return Trajectories(
        time=np.arange(2) * 0.05, latent=np.zeros((episodes, 1, 2)), skill=np.zeros((episodes, 1)),
        action=np.zeros((episodes, 1, 7)), reward=np.zeros((episodes, 1)), target=np.zeros((episodes, 3)),
        success=end <= tolerance, length=np.ones(episodes, dtype=int), gripper_position=path, violations=violations,
    )  # fmt: skip


# --- the same robots --------------------------------------------------------------------------------------------------


def test_whatever_is_judged_meets_the_same_robots(copy: Store) -> None:
    blind, again = moved(copy, ["real-like"]), moved(copy, ["real-like", "mild"], *REPLAN)
    assert (blind.results["replanned"], again.results["replanned"]) == (False, True)
    drawn = blind.group("domains/real-like")
    assert drawn.keys() == find_domain("real-like").parameters.keys()
    for name, values in again.group("domains/real-like").items():
        np.testing.assert_array_equal(values, drawn[name], err_msg=name)
    np.testing.assert_allclose(  # the start alone shows that they were used
        recording(again).achieved_goal[:3, 0], recording(blind).achieved_goal[:, 0], atol=1e-6
    )
    error = blind.arrays["episodes/replay_error"]
    np.testing.assert_allclose(again.arrays["episodes/replay_error"][:3], error), "the source's commands in both"


def test_two_domains_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "worn.toml").write_text('name = "worn"\n')
    a, b = (str(tmp_path / folder / "worn.toml") for folder in ("a", "b"))
    assert [domain.name for domain in find_domains([a, "mild"])] == ["worn", "mild"]
    with pytest.raises(UsageError, match="both called 'worn'"):
        find_domains([a, "mild", b])


# --- what is reported -------------------------------------------------------------------------------------------------


def test_reports_follow_from_the_stored_episodes(copy: Store) -> None:
    artifact = moved(copy, ["nominal", "real-like"], episodes=7)
    path, results, arrays = recording(artifact), artifact.results, artifact.arrays
    assert path.violations is not None and results["robot"] is None
    for found, here in zip(results["domains"], (slice(0, 1), slice(1, 8)), strict=True):
        part, rate = path.select(here), results["source"]["success_rate"]
        low, high = found["ci95"]
        assert found["gap"] == pytest.approx(rate - found["success_rate"])
        assert found["gap_ci95"] == pytest.approx([rate - high, rate - low]), "the source is known exactly"
        assert list(found["violations"]) == list(SAFETY_LIMITS[:3]), "there is no box"
        assert list(found["violations"].values()) == (part.violations > 0).sum(axis=0).tolist()  # type: ignore[operator]
        assert found["replay_error_m"] == pytest.approx(metrics.distance_summary(arrays["episodes/replay_error"][here]))
        order = np.argsort(-arrays["episodes/final_distance"][here], kind="stable")[:5]
        assert [each["episode"] for each in found["worst"]] == (order + here.start).tolist()
    worst_of = results["domains"][1]["worst"][0]
    assert worst_of["parameters"]["latency"] == arrays["domains/real-like/latency"][worst_of["episode"] - 1]
    assert "link_mass" not in worst_of["parameters"], "seven numbers"


def test_a_broken_limit_is_counted_and_takes_nothing_from_success() -> None:
    path = ended(0.0, 0.01, 0.2, violations=np.array([[0, 0, 4], [0, 0, 0], [1, 0, 1]]))
    assert path.within_limits.tolist() == [False, True, False]
    assert count_violations(path) == {"joint_range": 1, "joint_speed": 0, "table_clearance": 2}
    assert count_violations(replace(path, violations=None)) == {} and replace(path, violations=None).within_limits.all()


def test_the_worst_episodes_come_farthest_first_with_what_was_drawn() -> None:
    target = TargetRobots("mild", {"latency": np.arange(7) / 100, "gain": np.ones((7, 7))})
    found = worst(target, ended(0.1, 0.5, 0.2, 0.5, 0.0, 0.01, 0.3), first=10)
    assert [each.episode for each in found] == [11, 13, 16, 12, 10]
    assert found[0].parameters == {"latency": 0.01} and found[0].final_distance_m == pytest.approx(0.5)


def test_commands_sent_blindly_end_in_the_source_where_they_did_and_elsewhere_on_weak_servos(library: Library) -> None:
    artifact = library.source
    source = TransferEvaluator(library, 0, library.world).run(EpisodeSchedule.of(artifact, library), NOMINAL)
    trial = TransferEvaluator(library, 0, library.world)
    assert trial.replay(source, NOMINAL, 11) == pytest.approx(np.zeros(11), abs=1e-5)
    weak = trial.replay(source, TargetRobots("weak", {"gain": np.full((11, 7), 0.3)}), 11)
    assert (weak > 1e-3).any() and weak[8:] == pytest.approx(weak[:3], abs=1e-5), "skills in turn"


def test_what_a_robot_was_sent_leads_it_the_same_way_again(library: Library) -> None:
    weak = TargetRobots("weak", {"gain": np.full((8, 7), 0.1), "control_jitter": np.full(8, 0.02)}, episodes=8)
    trial = TransferEvaluator(library, 0, library.world)
    recorded = trial.run(EpisodeSchedule.of(library.source, library), weak)
    assert trial.replay(recorded, weak, 8) == pytest.approx(np.zeros(8), abs=1e-5)


# --- one parameter at a time ------------------------------------------------------------------------------------------


def test_one_parameter_alone_keeps_its_values_and_what_says_how_it_acts() -> None:
    drawn = {name: np.full(3, 0.5) for name in ("latency", "joint_drift", "drift_time", "push_rate", "arm_push")}
    alone = one_at_a_time(TargetRobots("all", drawn))
    assert {name: set(target.parameters) for name, target in alone.items()} == {
        "latency": {"latency"}, "joint_drift": {"joint_drift", "drift_time"}, "arm_push": {"arm_push", "push_rate"},
    }  # fmt: skip
    assert alone["latency"].parameters["latency"] is drawn["latency"]
    assert {"drift_time", "push_rate"} == MANNERS


def test_what_hurts_most_comes_first() -> None:
    varied = TargetRobots("mild", {"gain": np.ones((3, 7))})
    found = {"a": ended(0, 0, 0.1), "b": ended(0, 0.2, 0.3), "c": ended(0, 0.01, 0.1)}
    rows = most_harmful_first({name: (varied, path) for name, path in found.items()})
    assert [row.parameter for row in rows] == ["b", "c", "a"], "of two with equal successes the larger median distance"
    assert rows[0].successes == 1 and rows[0].ci95 == metrics.wilson_interval(1, 3)


@pytest.mark.parametrize("settings", [[], REPLAN])
def test_sensitivity_runs_every_parameter_alone_on_the_same_episodes(copy: Store, settings: list[str]) -> None:
    artifact = moved(copy, ["nominal", "latency-40"], *settings, sensitivity=True, episodes=2)
    nominal, late = artifact.results["domains"]
    assert nominal["sensitivity"] == []
    (row,) = late["sensitivity"]
    assert row["parameter"] == "latency", "a domain of one parameter is that parameter alone"
    for key in ("successes", "ci95", "final_distance_m"):
        assert row[key] == late[key]
    assert "sensitivity" not in moved(copy, ["nominal"]).results["domains"][0]


# --- other robots -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [[], REPLAN])
def test_episodes_run_on_another_robot_and_the_source_stays(copy: Store, settings: list[str]) -> None:
    robot = target_robot(ROBOT)
    own, other = moved(copy, ["mild"], *settings), moved(copy, ["mild"], *settings, robot=robot)
    assert other.results["robot"]["file"] == "servo.toml" and other.results["robot"]["fingerprint"] == robot.fingerprint
    assert other.results["source"] == own.results["source"], "planned and judged on our own model"
    assert np.abs(recording(own).achieved_goal[:, 1] - recording(other).achieved_goal[:, 1]).max() > 1e-4
    drawn = own.group("domains/mild")
    for name, values in other.group("domains/mild").items():
        np.testing.assert_array_equal(values, drawn[name], err_msg=name)


def test_another_robot_is_drawn_as_it_is_until_its_file_changes(copy: Store, tmp_path: Path) -> None:
    for file in (ROBOT, ROBOT.with_name("servo.xml")):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    own = scene_of(copy, moved(copy, ["nominal"]).id)
    other = moved(copy, ["nominal"], robot=target_robot(tmp_path / ROBOT.name))
    scene = scene_of(copy, other.id)
    assert scene.drawn and scene.other_robot == "servo.toml"
    assert own.model is not None and scene.model is not None and scene.source_model is not None
    assert scene.model.nbody != own.model.nbody and scene.source_model.nbody == own.model.nbody
    entities = record(scene, tmp_path / "scene.rrd")
    shown = {root: {e.split("/")[3] for e in entities if e.startswith(f"/{root}/model/")} for root in ("source", "world")}
    assert shown["world"] and shown["source"] and shown["world"] != shown["source"]
    slower = "timestep = 0.001\n" + (tmp_path / ROBOT.name).read_text()
    (tmp_path / ROBOT.name).write_text(slower)
    assert target_robot(tmp_path / ROBOT.name).fingerprint != other.results["robot"]["fingerprint"]
    assert not scene_of(copy, other.id).drawn
    (tmp_path / ROBOT.name).unlink()
    assert not scene_of(copy, other.id).drawn


LONG = 5000 * "a"
MADE_UP = [None, "", "servo.toml", "~\0x/servo.toml", "/dev/zero", "/none/servo.toml", f"/{LONG}/servo.toml", "/\0/servo.toml"]


@pytest.mark.parametrize("file", MADE_UP)
def test_a_robot_file_that_an_artifact_makes_up_is_not_drawn(copy: Store, file: str | None) -> None:
    other = moved(copy, ["nominal"], robot=target_robot(ROBOT))
    told = replace(other, measured={**other.measured, "robot_file": file})
    assert loading._target(told, TRANSFER_EVAL.results_of(other).robot, open_library(copy, other).world) is None


def test_notes_about_a_robot_are_told_and_kept(copy: Store) -> None:
    words = ("transfer-eval", str(SOURCE), "--domain", "nominal", "--robot", MESHES)
    result = skill("--store", copy.root, *words)
    assert result.code == 0, result.err
    notes = made("--store", copy.root, *words)["robot"]["notes"]
    assert any("hangs 2.0 cm off" in note and "`gravity_compensation = true`" in note for note in notes)
    assert all(note in " ".join(result.err.split()) for note in notes)


def test_robot_and_sensitivity_are_inputs_and_without_them_nothing_changes(chain: Path) -> None:
    source = Store(chain).read(SOURCE)
    recipe, robot = resolve(source.recipe), target_robot(ROBOT)
    usual = transfer_eval_inputs(source, recipe, ["mild"], 3, 0)
    assert usual == transfer_eval_inputs(source, recipe, ["mild"], 3, 0, None, False)
    other = transfer_eval_inputs(source, recipe, ["mild"], 3, 0, robot)
    much = transfer_eval_inputs(source, recipe, ["mild"], 3, 0, None, True)
    again = transfer_eval_inputs(source, recipe, ["mild"], 3, 0, replace(robot, fingerprint="0" * 64))
    assert len({usual, other, much, again}) == 4


# --- robots that break ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [[], REPLAN])
def test_a_robot_that_comes_apart_fails_and_leaves_no_nan(
    copy: Store, tmp_path: Path, settings: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skillcli.simulation.arms._FASTEST", 5.0)  # rad/s, so that it comes apart at once
    (tmp_path / "nasty.toml").write_text(NASTY)
    artifact = moved(copy, [str(tmp_path / "nasty.toml")], *settings, episodes=2)
    (found,) = artifact.results["domains"]
    assert (found["successes"], found["episodes"]) == (0, 2)
    assert recording(artifact).length.max() <= 2, "it ends where the simulation fails"
    assert copy.verify(artifact.id) == []
    for name, array in artifact.arrays.items():
        assert np.isfinite(array).all(), name
    assert found["unstable"] == 2, "said as what it is, and no distance out of it"
    assert {*found["final_distance_m"].values(), *found["replay_error_m"].values()} == {None}
    assert [each["final_distance_m"] for each in found["worst"]] == [None, None]
    table = shown(artifact)
    assert "unstable: nasty in 2 of 2 episodes; the simulation diverged, no distance is counted" in table and "nan" not in table
    draw(copy, artifact.id, tmp_path / "a.png")


def test_distances_are_of_the_episodes_that_did_not_come_apart() -> None:
    path = replace(ended(0.1, 31.6, 0.3), unstable=np.array([False, True, False]))
    found = outcome(path, repeats=False)
    assert (found.unstable, found.episodes) == (1, 3) and found.final_distance_m.mean == pytest.approx(0.2)
    assert [each.episode for each in worst(TargetRobots("mild", {}), path, 0)] == [1, 2, 0]
    joined = Trajectories.join([ended(0.1), path])
    assert joined.stable.tolist() == [True, True, False, True]


# --- what repeats, and what can be extended ---------------------------------------------------------------------------

BUSY = """name = "busy"
extends = "real-like"
[parameters]
joint_drift = 0.01
drift_time = 0.5
control_jitter = 0.05
push_rate = { one_of = [0.0, 5.0] }
arm_push = 1.0
"""


def test_more_episodes_leave_the_first_ones_as_they_were(copy: Store, tmp_path: Path) -> None:
    (tmp_path / "busy.toml").write_text(BUSY)
    domain = str(tmp_path / "busy.toml")
    few, many = (moved(copy, [domain], episodes=episodes) for episodes in (2, 5))
    for name, values in few.group("domains/busy").items():
        np.testing.assert_array_equal(many.group("domains/busy")[name][:2], values, err_msg=name)
    a, b = recording(few), recording(many).select(slice(0, 2))
    np.testing.assert_allclose(a.joint_position, b.joint_position[:, : len(a.time)], atol=1e-4)  # type: ignore[index]
    np.testing.assert_allclose(few.arrays["episodes/replay_error"], many.arrays["episodes/replay_error"][:2], atol=1e-4)


def test_what_repeats_is_played_once_and_has_no_interval(copy: Store, tmp_path: Path) -> None:
    (tmp_path / "noisy.toml").write_text('name = "noisy"\n[parameters]\njoint_noise = 0.01\n')
    domains = ["nominal", "latency-40", str(tmp_path / "noisy.toml"), "mild"]
    artifact = moved(copy, domains, episodes=4)
    found = {each["name"]: each for each in artifact.results["domains"]}
    assert {name: (each["episodes"], each["deterministic"]) for name, each in found.items()} == {
        "nominal": (1, True), "latency-40": (1, True), "noisy": (4, False), "mild": (4, False),
    }  # fmt: skip
    assert found["nominal"]["ci95"] == [found["nominal"]["success_rate"]] * 2
    assert artifact.arrays["episodes/domain"].tolist() == [0, 1, 2, 2, 2, 2, 3, 3, 3, 3]
    assert len(artifact.arrays["domains/latency-40/latency"]) == 1
    table = shown(artifact)
    assert "nominal, latency-40: deterministic, one episode of each route or skill, no interval" in table and "exact" in table
    assert scene_of(copy, artifact.id).episode_labels == (
        "nominal 0", "latency-40 0", *(f"noisy {k}" for k in range(4)), *(f"mild {k}" for k in range(4)),
    )  # fmt: skip
    farthest = max((each["worst"][0] for each in found.values()), key=lambda each: each["final_distance_m"])["episode"]
    assert f"farthest off: {scene_of(copy, artifact.id).episode_labels[farthest]}," in table
    draw(copy, artifact.id, tmp_path / "a.png")


@pytest.mark.parametrize("settings", [[], REPLAN])
def test_progress_counts_episodes_over_all_domains(copy: Store, settings: list[str]) -> None:
    told: list[Progress] = []
    moved(copy, ["nominal", "mild"], *settings, episodes=3, on_progress=told.append)
    told = [each for each in told if each.stage == "transfer-eval"]
    done = [each.done for each in told]
    assert {(each.total, each.unit) for each in told} == {(4, "episodes")}
    assert done == sorted(done) and done[-1] == 4 and 1 in done
    assert told[-1].success.keys() == {"nominal", "mild"}
    assert not settings or ({2, 3} <= set(done) and "mild, episode 2 of 3" in [each.note for each in told])
