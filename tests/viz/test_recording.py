"""Recordings, read back from the file."""

import subprocess
import sys
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import mujoco
import numpy as np
import pytest
import scenes
from rerun.chunk import RrdReader

from skillcli.errors import SkillError
from skillcli.viz import motion, recording
from skillcli.viz.palette import look, rgba
from skillcli.viz.recording import notes, record
from skillcli.viz.recording.clock import PAUSE_S, clocks
from skillcli.viz.recording.space import rest_after
from skillcli.viz.scene import Scene


def column(path: Path, entity: str, name: str) -> list[object]:
    """All rows of one column of an entity, in the order of the file."""
    rows: list[object] = []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and name in batch.schema.names:
            rows += batch.column(name).to_pylist()
    return rows


def packed(color: str, alpha: float = 1.0) -> int:
    red, green, blue, opacity = rgba(color, alpha)
    return red << 24 | green << 16 | blue << 8 | opacity


@pytest.mark.parametrize("task", scenes.TASKS)
@pytest.mark.parametrize("kind", scenes.RUNS)
def test_every_kind_is_recorded_with_what_its_views_show(kind: str, task: str, tmp_path: Path) -> None:
    scene = scenes.make(kind, task)
    path = tmp_path / "scene.rrd"
    entities = record(scene, path)
    assert entities == sorted(set(entities))
    expected = {"/provenance", "/world/goals/centers", "/world/now", "/latent/means", "/latent/now", "/series/latent"}
    expected |= {f"/series/{name}/" for name in ("distance", "reward", "success", "action_norm")}
    expected |= {"/learning/success/skill-1"} if kind == "pretrain" else set()
    expected |= {"/world/waypoints/tolerance"} if len(scene.waypoints) else {"/world/goals/tolerance"}
    expected |= {"/series/joint_speed", "/world/model/lower/capsule"} if task != "point" else set()
    expected |= {"/world/model/box/box"} if task == "push" else set()
    expected |= {"/episode"}
    expected |= {"/source/now", "/source/path", "/world/planned", "/world/executed"} if kind == "transfer-eval" else set()
    expected |= {"/source/model/lower"} if kind == "transfer-eval" and task != "point" else set()
    for entity in expected:
        assert any(found.startswith(entity) for found in entities), f"{entity} is missing from {entities}"
    assert path.stat().st_size < 5_000_000
    assert RrdReader(path).blueprints(), "it would open without its layout"
    assert list(tmp_path.iterdir()) == [path]


def test_limits_that_are_broken_have_a_view_of_their_own(tmp_path: Path) -> None:
    scene = scenes.make("compose", "reach")
    assert "/series/violations" not in record(scene, tmp_path / "kept.rrd")
    record(scenes.breaking(scene, 30), tmp_path / "broken.rrd")
    (names,) = column(tmp_path / "broken.rrd", "/series/violations", "SeriesLines:names")
    assert names == ["joint_range", "joint_speed", "table_clearance"]
    steps = len(scene.trajectories.time) - 1
    rows = column(tmp_path / "broken.rrd", "/series/violations", "Scalars:scalars")
    assert rows == [[0.0, float(step >= 30), 0.0] for step in range(steps)]


def test_the_file_passes_the_viewers_own_check(tmp_path: Path) -> None:
    record(scenes.make("compose", "push"), tmp_path / "scene.rrd")
    viewer = Path(sys.executable).parent / "rerun"
    if not viewer.exists():
        pytest.skip("no viewer beside this Python")
    done = subprocess.run([viewer, "rrd", "verify", tmp_path / "scene.rrd"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_bodies_move_as_in_mujoco(tmp_path: Path) -> None:
    scene = scenes.make("compose", "push")
    record(scene, tmp_path / "scene.rrd")
    data = scene.trajectories
    assert data.joint_position is not None and data.object_pose is not None
    assert scene.model is not None
    state = mujoco.MjData(scene.model)
    for name in ("upper", "lower", "box"):
        places = column(tmp_path / "scene.rrd", f"/world/model/{name}", "Transform3D:translation")
        turns = column(tmp_path / "scene.rrd", f"/world/model/{name}", "Transform3D:quaternion")
        assert len(places) == len(data.time)
        for row in (0, 7, len(data.time) - 1):
            state.qpos[:3] = data.joint_position[0, row]
            state.qpos[3:] = data.object_pose[0, row]
            mujoco.mj_forward(scene.model, state)
            body = state.body(name)
            assert np.allclose(places[row], body.xpos, atol=1e-6)
            assert np.allclose(turns[row], body.xquat[[1, 2, 3, 0]], atol=1e-6)


def test_a_body_that_cannot_move_stands_where_the_model_puts_it(tmp_path: Path) -> None:
    scene = scenes.make("compose", "reach")
    record(scene, tmp_path / "scene.rrd")
    assert scene.model is not None
    assert np.allclose(
        column(tmp_path / "scene.rrd", "/world/model/base", "Transform3D:quaternion"),
        scene.model.body("base").quat[[1, 2, 3, 0]],
    )


def test_capsules_begin_where_mujocos_do(tmp_path: Path) -> None:
    record(scenes.make("compose", "reach"), tmp_path / "scene.rrd")
    entity = "/world/model/upper/capsule"
    (start,), (length,) = (
        column(tmp_path / "scene.rrd", entity, name) for name in ("Capsules3D:translations", "Capsules3D:lengths")
    )
    # "fromto 0 0 0 0.45 0 0": one end in the joint; the other follows from the rotation of z onto x
    assert length == pytest.approx([0.45])
    ends = np.array([[0, 0, 0], [0.45, 0, 0]])
    assert min(np.linalg.norm(np.array(start)[0] - end) for end in ends) < 1e-6


def test_meshes_are_drawn_with_their_faces_and_colour(tmp_path: Path) -> None:
    path = tmp_path / "scene.rrd"
    entities = record(with_mesh(), path)
    assert "/world/model/hand/mesh/0-tip" in entities
    (faces,) = column(path, "/world/model/hand/mesh/0-tip", "Mesh3D:triangle_indices")
    (color,) = column(path, "/world/model/hand/mesh/0-tip", "Mesh3D:albedo_factor")
    assert len(np.reshape(faces, (-1, 3))) == 4
    assert color == [51 << 24 | 102 << 16 | 153 << 8 | 255]
    assert column(path, "/world/model/hand", "Transform3D:translation")


@pytest.mark.parametrize(("largest", "vertices"), [(1, 8), (10**9, 4)])
def test_meshes_that_would_make_the_file_too_large_are_drawn_more_simply(
    largest: int, vertices: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "LARGEST", largest)
    record(with_mesh(), tmp_path / "scene.rrd")
    (found,) = column(tmp_path / "scene.rrd", "/world/model/hand/mesh/0-tip", "Mesh3D:vertex_positions")
    assert len(np.reshape(found, (-1, 3))) == vertices


def with_mesh() -> Scene:
    """A scene of an arm with one joint, that is a mesh."""
    scene = scenes.make("compose", "reach")
    assert scene.trajectories.joint_position is not None
    moved = replace(scene.trajectories, joint_position=scene.trajectories.joint_position[..., :1])
    model = mujoco.MjModel.from_xml_string(scenes.TETRAHEDRON)
    return replace(scene, trajectories=moved, model=model, joints=("right_j0",))


def test_paths_are_cut_and_coloured_by_skill(tmp_path: Path) -> None:
    scene = scenes.make("compose", "reach")
    record(scene, tmp_path / "scene.rrd")
    entity = "/world/paths/composed/000-triangle"
    (colors,) = column(tmp_path / "scene.rrd", entity, "LineStrips3D:colors")
    (strips,) = column(tmp_path / "scene.rrd", entity, "LineStrips3D:strips")
    pieces = motion.pieces(scene, 0)
    assert [piece.skill for piece in pieces].count(-1) == 4
    assert colors == [packed(motion.piece_look(scene, 0, piece).color) for piece in pieces]
    for piece, strip in zip(pieces, strips, strict=True):
        assert np.allclose(strip, scene.trajectories.achieved_goal[0, piece.start : piece.stop + 1], atol=1e-6)


def test_sampled_latents_share_one_entity_per_skill(tmp_path: Path) -> None:
    scene = scenes.make("pretrain", "reach", sampled=3)
    record(scene, tmp_path / "scene.rrd")
    (colors,) = column(tmp_path / "scene.rrd", "/world/paths/skill-5/others", "LineStrips3D:colors")
    assert colors == [packed(look(4).color, 0.5)] * 3


def test_episodes_play_one_after_another_on_both_timelines(tmp_path: Path) -> None:
    scene = scenes.make("embed-means", "point")
    record(scene, tmp_path / "scene.rrd")
    played = clocks(scene)
    assert [clock.first_step for clock in played] == [0, 61, 122, 183]
    assert played[1].start == pytest.approx(3.0 + PAUSE_S)
    entity = "/series/distance/001-skill-2"
    times, steps = (column(tmp_path / "scene.rrd", entity, name) for name in ("sim_time", "step"))
    assert steps == list(range(61, 122))
    assert times[0] == timedelta(seconds=3.0 + PAUSE_S)
    values = np.ravel(column(tmp_path / "scene.rrd", entity, "Scalars:scalars"))
    assert values == pytest.approx(motion.distance(scene, 1))


def test_learning_curves_have_their_own_timeline(tmp_path: Path) -> None:
    scene = scenes.make("pretrain", "point")
    record(scene, tmp_path / "scene.rrd")
    chunks = [c for c in RrdReader(tmp_path / "scene.rrd").stream() if c.entity_path == "/learning/final_distance"]
    assert [chunk.timeline_names for chunk in chunks] == [["iteration"]]
    assert np.ravel(column(tmp_path / "scene.rrd", "/learning/final_distance", "Scalars:scalars")) == pytest.approx(
        scene.curves["final_distance"]
    )


def test_terms_of_the_reward_are_curves_by_name(tmp_path: Path) -> None:
    scene = scenes.rewarded(scenes.make("pretrain", "point"))
    record(scene, tmp_path / "scene.rrd")
    (names,) = column(tmp_path / "scene.rrd", "/learning/reward/goal", "SeriesLines:names")
    assert names == ["goal"]
    rows = np.ravel(column(tmp_path / "scene.rrd", "/learning/reward/goal", "Scalars:scalars"))
    np.testing.assert_allclose(rows, scene.curves["reward/goal"])


def test_one_place_that_is_due_twice_has_one_label(tmp_path: Path) -> None:
    record(scenes.make("compose", "reach"), tmp_path / "scene.rrd")
    (labels,) = column(tmp_path / "scene.rrd", "/world/waypoints/names", "Points3D:labels")
    assert sorted(labels) == ["waypoint 1, 4", "waypoint 2", "waypoint 3"]


def test_the_source_moves_as_planned_while_the_target_does_not(tmp_path: Path) -> None:
    scene = scenes.make("transfer-eval", "push")
    record(scene, tmp_path / "scene.rrd")
    sent = motion.sent(scene)
    assert sent is not None
    rows = len(scene.trajectories.time)
    found = (column(tmp_path / "scene.rrd", f"/{root}/model/box", "Transform3D:translation") for root in ("source", "world"))
    source, target = (np.array(places).reshape(-1, 3) for places in found)
    assert len(source) == len(target) == rows * len(motion.played(scene))
    assert np.allclose(source[:rows, :2], motion.path(sent, 0)[:, :2], atol=1e-6)
    assert np.allclose(target[:rows, :2], motion.path(scene, motion.played(scene)[0])[:, :2], atol=1e-6)
    assert np.abs(source[rows - 1] - target[rows - 1]).max() > 0.01, "the worst episode comes first"


def test_a_source_that_has_less_time_than_the_target_is_shown_to_the_end(tmp_path: Path) -> None:
    scene = scenes.make("transfer-eval", "reach")
    assert scene.source is not None
    short = {name: values[:, :6] for name, values in scene.source.arrays().items() if name not in ("time", "target", "success")
             and values.ndim > 1 and values.shape[1] == len(scene.source.time)}  # fmt: skip
    cut = replace(scene.source, time=scene.source.time[:6], length=np.array([5]), **short)
    record(replace(scene, source=cut), tmp_path / "scene.rrd")
    found = (column(tmp_path / "scene.rrd", f"/{root}/model/lower", "Transform3D:quaternion") for root in ("source", "world"))
    source, target = (len(rows) for rows in found)
    assert source == target > 6


def test_another_robot_is_not_drawn_as_the_source(tmp_path: Path) -> None:
    scene = replace(scenes.make("transfer-eval", "push"), other_robot="other.toml")
    entities = record(scene, tmp_path / "scene.rrd")
    shown = {root: {e.split("/")[3] for e in entities if e.startswith(f"/{root}/model/")} for root in ("source", "world")}
    assert shown["source"] - shown["world"] == {"base", "upper", "lower"} and "box" in shown["world"]


def test_a_source_that_ends_early_rests_until_the_target_ends() -> None:
    scene = scenes.make("compose", "point")
    short = replace(scene, trajectories=replace(scene.trajectories, length=np.array([3])))
    assert rest_after(np.arange(6), short, 0).tolist() == [0, 1, 2, 3, 3, 3]


def test_an_episode_says_what_was_drawn_for_it_and_where_it_ends(tmp_path: Path) -> None:
    scene = scenes.make("transfer-eval", "reach")
    gap = 100 * np.linalg.norm(scene.trajectories.achieved_goal[13, -1] - scene.trajectories.target[13])
    assert notes.label(scene, 13) == f"real-like 1: ends {gap:.1f} cm off\nlatency 50 ms"
    assert "latency" not in notes.label(scene, 0), "nothing was drawn on the nominal robot"
    told = notes.card(scene, 13)
    assert "| latency | 0.05 | s |" in told and "| gain | 1.25 1.25" in told
    record(scene, tmp_path / "scene.rrd")
    labels = [row[0] for row in column(tmp_path / "scene.rrd", "/world/now", "Points3D:labels") if row]
    assert labels == [notes.title(scene, episode) for episode in motion.played(scene)]
    first = motion.played(scene)[0]
    (names,) = column(tmp_path / "scene.rrd", f"/series/distance/{first:03d}-real-like-{first - 12}", "SeriesLines:names")
    assert names == [notes.label(scene, first)]
    assert column(tmp_path / "scene.rrd", "/episode", "TextDocument:text") == [
        [notes.card(scene, episode)] for episode in motion.played(scene)
    ]


def test_a_missing_folder_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SkillError, match=r"cannot write .*No such file or directory"):
        record(scenes.make("compose", "point"), tmp_path / "nowhere" / "scene.rrd")


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.rrd"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("skillcli.viz.recording.log_curves", full)
    with pytest.raises(SkillError, match="No space left"):
        record(scenes.make("compose", "point"), path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
