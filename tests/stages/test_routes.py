"""A push library, and a composition of several routes: each planned and run from the start, and judged for itself."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from command import CHAIN, PLACES, made, skill
from rich.console import Console
from worlds import JOINTS, named_routes

from skillcli import metrics
from skillcli.cli.tables import table_of
from skillcli.composition.plan import Segment
from skillcli.errors import UsageError
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.inputs import compose_inputs
from skillcli.evaluation.library import open_library
from skillcli.evaluation.sampled_robots import SampledRobots
from skillcli.evaluation.transfer_evaluator import TargetRobots, TransferEvaluator
from skillcli.recipe import load_recipe
from skillcli.simulation.domains import find_domain
from skillcli.stages.compose import Request, execute
from skillcli.stages.pretrain import evaluate
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.world import World
from skillcli.trajectories import Array, Trajectories
from skillcli.viz import motion
from skillcli.viz.loading import scene_of
from skillcli.viz.visualise import draw, record

# What `push_chain` is composed of, m.
ROUTES = tuple(np.array([[0.6 + x, y, 0.0] for x, y in route]) for route in PLACES)


def read(chain: Path, stage: str) -> Artifact:
    return Store(chain).read(ArtifactId("pushed", stage, 1))


def recording(artifact: Artifact) -> Trajectories:
    return Trajectories(**artifact.group("trajectories"))


def steps_of(artifact: Artifact) -> Array:
    """Control steps of each segment."""
    return np.round(artifact.arrays["plan/seconds"] / 0.05).astype(int)


@pytest.mark.parametrize("stage", CHAIN)
def test_every_artifact_of_a_push_is_whole_and_its_recording_agrees_with_itself(push_chain: Path, stage: str) -> None:
    artifact = read(push_chain, stage)
    assert Store(push_chain).verify(artifact.id) == []
    path = recording(artifact)
    assert path.object_pose is not None and path.gripper_position is not None
    assert path.object_pose.shape == (path.episodes, len(path.time), 7) and np.isfinite(path.object_pose).all()
    np.testing.assert_allclose(np.linalg.norm(path.object_pose[..., 3:], axis=-1), 1, atol=1e-5)
    np.testing.assert_array_equal(path.achieved_goal[..., :2], path.object_pose[..., :2])
    assert (path.achieved_goal[..., 2] == 0).all() and (path.target[:, 2] == 0).all(), "in the plane of the table"


def test_how_far_the_box_was_turned_is_told(push_chain: Path) -> None:
    trained, composed, moved = (read(push_chain, stage) for stage in ("pretrain", "compose", "transfer-eval"))
    turned = [skill["final_yaw_deg"] for skill in trained.results["skills"]]
    recording = Trajectories(**trained.group("trajectories"))
    all_of_them = metrics.final_yaw(recording)
    assert all_of_them is not None and turned == pytest.approx(all_of_them[:: recording.episodes // len(turned)])
    assert len(composed.results["final_yaws_deg"]) == composed.results["routes"]
    for domain in moved.results["domains"]:
        assert 0 <= domain["final_yaw_deg"]["median"] <= domain["final_yaw_deg"]["p90"] <= 180
    for artifact in (trained, composed, moved):
        console = Console(width=120, file=io.StringIO())
        console.print(table_of(artifact))
        assert isinstance(console.file, io.StringIO) and "turned" in console.file.getvalue()


def test_stored_push_skills_act_as_the_trained_ones_did(push_chain: Path) -> None:
    artifact = read(push_chain, "pretrain")
    weights = artifact.group("weights")
    assert weights["privileged_normalizer.mean"].shape == (11,)
    assert weights["value.body.0.weight"].shape[1] == 12 + 11 + 2 + 4, "the value function sees the whole simulation"
    assert weights["policy.body.0.weight"].shape[1] <= 12 + 2, "the policy does not"
    library = open_library(Store(push_chain), artifact)
    again = evaluate(library.recipe, library.world, library.agent, seed=0, threads=1)
    np.testing.assert_array_equal(again.final_distance, artifact.arrays["evaluation/final_distance"])
    for name, array in library.agent.arrays().items():
        np.testing.assert_array_equal(array, weights[name], err_msg=name)


def test_push_skills_are_judged_on_the_nominal_robot_from_the_nominal_start(push_chain: Path) -> None:
    artifact = read(push_chain, "pretrain")
    path = recording(artifact)
    np.testing.assert_allclose(path.achieved_goal[:, 0], [[0.6, 0, 0]] * path.episodes, atol=1e-6)
    np.testing.assert_allclose(artifact.arrays["skills/goal"], [[0.75, 0, 0], [0.45, 0, 0], [0.6, 0.15, 0], [0.6, -0.15, 0]])
    assert [skill["name"] for skill in artifact.results["skills"]] == ["up", "down", "left", "right"]


def test_what_differed_in_training_is_judged_all_at_once(push_chain: Path) -> None:
    found = read(push_chain, "pretrain").results["randomised"]
    assert found["episodes"] == 4 * (1 + 3)
    successes = round(found["success_rate"] * 16)
    assert found["ci95"] == pytest.approx(metrics.wilson_interval(successes, 16))
    # goals 15 cm from the nominal start, boxes up to 5 cm beside it along either axis
    assert 0.1 - 0.001 <= found["final_distance_m"]["mean"] <= 0.21
    assert found["final_distance_m"]["p90"] > found["final_distance_m"]["median"] + 1e-3, "the starts differ"


def test_the_halves_of_four_pushes_are_the_four_sides(push_chain: Path) -> None:
    artifact = read(push_chain, "embed-means")
    found = [(pair["from"], pair["to"]) for pair in artifact.results["halfway"]]
    assert found == [("up", "left"), ("up", "right"), ("down", "left"), ("down", "right")]
    np.testing.assert_allclose(recording(artifact).target[4], [0.675, 0.075, 0])
    assert [pair["magnitude_ratio"] for pair in artifact.results["halfway"]] == pytest.approx([0] * 4, abs=0.5)


# --- what is asked ----------------------------------------------------------------------------------------------------


def test_a_named_task_may_have_several_routes_and_typed_goals_are_one() -> None:
    push = load_recipe("push")
    ring = Request.of(push, "ring", ())
    assert len(ring.routes) == 12 and ring.waypoints.shape == (12, 3) and ring.route.tolist() == list(range(12))
    typed = Request.of(push, "", [(0.1, 0.0), (0.1, 0.1)])
    (route,) = typed.routes
    np.testing.assert_allclose(route, [[0.7, 0, 0], [0.7, 0.1, 0]])
    assert typed.route.tolist() == [0, 0] and typed.task == ""
    with pytest.raises(UsageError, match="2 numbers, got 3"):
        Request.of(push, "", [(0.1, 0.0, 0.0)])
    with pytest.raises(UsageError, match="no room for the box"):
        Request.of(push, "", [(0.1, 0.0), (0.1, 0.7)])


def test_the_same_waypoints_on_other_routes_are_another_composition(push_chain: Path) -> None:
    source, push = read(push_chain, "embed-means"), load_recipe("push")
    a, b = np.array([[0.7, 0, 0]]), np.array([[0.6, 0.1, 0]])
    requests = [Request("", (np.concatenate([a, b]),)), Request("", (a, b)), Request("", (b, a))]
    assert len({compose_inputs(source, push, World.of(push), request, "search") for request in requests}) == 3


# --- what is composed -------------------------------------------------------------------------------------------------


def test_each_route_is_planned_and_run_from_the_start(push_chain: Path) -> None:
    artifact = read(push_chain, "compose")
    path, arrays, steps = recording(artifact), artifact.arrays, steps_of(artifact)
    assert path.episodes == 3 and path.joint_position is not None
    assert arrays["plan/route"].tolist() == sorted(arrays["plan/route"]) and set(arrays["plan/route"]) == {0, 1, 2}
    for route in range(3):
        mine = arrays["plan/route"] == route
        length = int(steps[mine].sum())
        assert path.length[route] == length
        np.testing.assert_array_equal(path.joint_position[route, 0], path.joint_position[0, 0])
        np.testing.assert_allclose(path.achieved_goal[route, 0], [0.6, 0, 0], atol=1e-6)
        fed = np.repeat(arrays["plan/latent"][mine], steps[mine], axis=0)
        np.testing.assert_allclose(path.latent[route, :length], fed, atol=1e-6)
    assert path.length[0] == 1 < path.length[1:].min() and len(path.time) == path.length.max() + 1
    np.testing.assert_array_equal(path.achieved_goal[0, 1:], np.repeat(path.achieved_goal[0, 1:2], len(path.time) - 1, axis=0))


def test_a_route_alone_does_the_same(push_chain: Path) -> None:
    artifact = read(push_chain, "compose")
    library, arrays, steps = open_library(Store(push_chain), artifact), artifact.arrays, steps_of(artifact)
    for route, waypoints in enumerate(ROUTES):
        plan = [
            Segment(arrays["plan/latent"][i], int(arrays["plan/skill"][i]), "", int(steps[i]))
            for i in np.flatnonzero(arrays["plan/route"] == route)
        ]
        alone = execute(library, plan, waypoints, SampledRobots())
        together = recording(artifact).select([route])
        assert alone.success.tolist() == together.success.tolist()
        np.testing.assert_array_equal(alone.padded(len(together.time) - 1).object_pose, together.object_pose)


def test_each_route_is_judged_by_its_own_waypoints(push_chain: Path) -> None:
    artifact = read(push_chain, "compose")
    results, arrays, path = artifact.results, artifact.arrays, recording(artifact)
    np.testing.assert_allclose(arrays["waypoints/target"], np.concatenate(ROUTES))
    assert arrays["waypoints/route"].tolist() == [0, 1, 1, 1, 2]
    np.testing.assert_allclose(path.target, [[0.6, 0, 0], [0.8, 0, 0], [0.7, 0.1, 0]])
    distance = metrics.final_distance(path)
    for route in range(3):
        mine = arrays["waypoints/route"] == route
        closest = metrics.ordered_approach(path.achieved_goal[route], arrays["waypoints/target"][mine], 0.05)
        np.testing.assert_allclose(arrays["waypoints/closest"][mine], closest)
        assert bool(path.success[route]) == bool((closest <= 0.05).all() and distance[route] <= 0.05)
    assert path.success.tolist() == [True, False, False]
    assert (results["success"], results["routes"]) == (False, 3) and results["success_rate"] == pytest.approx(1 / 3)
    assert results["final_distances_m"] == pytest.approx(distance.tolist())
    assert results["final_distance_m"] == pytest.approx(distance.max()), "the worst of them"


def test_reports_name_the_route_of_every_segment_and_waypoint(push_chain: Path) -> None:
    artifact = read(push_chain, "compose")
    results, arrays = artifact.results, artifact.arrays
    assert [segment["route"] for segment in results["segments"]] == arrays["plan/route"].tolist()
    assert [waypoint["route"] for waypoint in results["waypoints"]] == [0, 1, 1, 1, 2]
    assert results["plan_seconds"] == pytest.approx(arrays["plan/seconds"].sum())
    assert 0 < results["expanded_nodes"] <= 3 * 12, "the budget is for each route"


# --- on other robots --------------------------------------------------------------------------------------------------


def test_a_script_runs_the_routes_in_turn_each_to_its_own_end(push_chain: Path) -> None:
    artifact = read(push_chain, "compose")
    library, path = open_library(Store(push_chain), artifact), recording(artifact)
    script = EpisodeSchedule.of(artifact, library).in_turn(7)
    turn = [0, 1, 2, 0, 1, 2, 0]
    assert script.steps.tolist() == path.length[turn].tolist()
    np.testing.assert_array_equal(script.latent, path.latent[turn])
    assert [len(route) for route in script.waypoints] == [1, 3, 1, 1, 3, 1, 1]
    for index, route in zip(turn, script.waypoints, strict=True):
        np.testing.assert_allclose(route, ROUTES[index])
    once = EpisodeSchedule.of(artifact, library)
    assert len(once.waypoints) == len(once.latent) == 3, "one episode of each says it all"


def test_the_nominal_robot_does_with_every_route_what_the_source_did(push_chain: Path) -> None:
    source, artifact = recording(read(push_chain, "compose")), read(push_chain, "transfer-eval")
    path = recording(artifact)
    assert artifact.arrays["episodes/domain"].tolist() == [0] * 3 + [1] * 7
    assert path.gripper_position is not None and source.gripper_position is not None
    for route in range(3):
        episode = route
        np.testing.assert_allclose(path.gripper_position[episode], source.gripper_position[route], atol=1e-4)
        assert (path.length[episode], path.success[episode]) == (source.length[route], source.success[route])
        np.testing.assert_array_equal(path.target[[episode, 3 + episode]], source.target[[route, route]])
    assert artifact.results["source"]["episodes"] == 3
    assert artifact.results["source"]["success_rate"] == pytest.approx(1 / 3)
    nominal = artifact.results["domains"][0]
    assert (nominal["successes"], nominal["episodes"], nominal["retention"]) == (1, 3, 1.0)
    assert nominal["ci95"] == pytest.approx([1 / 3, 1 / 3]) and nominal["gap_ci95"] == [0, 0]


def test_bare_pushes_are_judged_from_random_starts_too(push_chain: Path) -> None:
    artifact = read(push_chain, "embed-means")
    library = open_library(Store(push_chain), artifact)
    target = TargetRobots.drawn(find_domain("random-starts"), 8, 1, JOINTS)
    path, drawn = (
        TransferEvaluator(library, 1, library.world).run(EpisodeSchedule.of(artifact, library).in_turn(8), target),
        target.parameters,
    )
    np.testing.assert_allclose(path.achieved_goal[:, 0, :2] - drawn["object_offset"], [[0.6, 0]] * 8, atol=1e-6)
    np.testing.assert_array_equal(path.target, library.goals[[0, 1, 2, 3, 0, 1, 2, 3]], "the goals stay")
    task = library.recipe.task
    assert path.joint_position is not None and isinstance(task, PushTask)
    start = np.array(task.start)
    np.testing.assert_allclose(path.joint_position[:, 0] - drawn["start_offset"], [start] * 8, atol=1e-5)


# --- what is shown ----------------------------------------------------------------------------------------------------


def test_a_scene_knows_the_route_of_every_episode_and_waypoint(push_chain: Path) -> None:
    store = Store(push_chain)
    composed, moved = (scene_of(store, ArtifactId("pushed", stage, 1)) for stage in ("compose", "transfer-eval"))
    assert composed.episode_route.tolist() == [0, 1, 2] and composed.waypoint_route.tolist() == [0, 1, 1, 1, 2]
    assert composed.episode_labels == ("search places 1", "search places 2", "search places 3")
    assert moved.episode_route.tolist() == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0] and moved.waypoint_route.tolist() == [0, 1, 1, 1, 2]
    closest = read(push_chain, "compose").arrays["waypoints/closest"]
    found = np.concatenate([motion.closest(composed, episode) for episode in range(3)])
    np.testing.assert_allclose(found, closest, atol=1e-6)
    means = scene_of(store, ArtifactId("pushed", "embed-means", 1))
    assert means.episode_labels[3:5] == ("skill right", "between up and left")


@pytest.mark.parametrize("stage", ["compose", "transfer-eval"])
def test_several_routes_become_a_figure_and_a_recording(push_chain: Path, tmp_path: Path, stage: str) -> None:
    store, artifact_id = Store(push_chain), ArtifactId("pushed", stage, 1)
    draw(store, artifact_id, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    entities = record(store, artifact_id, tmp_path / "a.rrd")
    assert any(entity.startswith("/world/model/box") for entity in entities)


def test_the_ring_is_composed_by_name_and_told_by_how_many_routes_succeed(push_chain: Path, tmp_path: Path) -> None:
    store = shutil.copytree(push_chain, tmp_path / "artifacts")
    words = ("--store", store, "compose", "pushed/embed-means", "--task", "ring", "--set", "search.budget=1")
    found = made(*words)
    assert (found["task"], found["routes"], found["success_rate"]) == ("ring", 12, 0)
    asked = np.concatenate(named_routes(load_recipe("push").task, "ring"))
    np.testing.assert_allclose([waypoint["target"] for waypoint in found["waypoints"]], asked)
    assert found["final_distances_m"] == pytest.approx([0.2] * 12, abs=0.05)
    assert "0 of 12 routes succeed" in skill(*words).out
