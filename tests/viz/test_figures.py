"""Figures: what is drawn, and what is left behind."""

import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import scenes
from matplotlib.figure import Figure
from matplotlib.image import imread

from skillcli.errors import SkillError, UsageError
from skillcli.viz import figure_style, motion, subplots_space, subplots_time
from skillcli.viz.figures import draw, figure
from skillcli.viz.palette import look
from skillcli.viz.paper_figures import learning

pytestmark = pytest.mark.slow


def titles(drawn: Figure) -> list[str]:
    return [axes.get_title(loc="left") or axes.get_title() for axes in drawn.axes]


@pytest.mark.parametrize(
    ("kind", "task"),
    [
        *((kind, "reach") for kind in scenes.RUNS),
        ("pretrain", "point"),
        ("compose", "push"),
        ("transfer-eval", "push"),
    ],
)
def test_every_kind_gives_a_picture_with_ink(kind: str, task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figure_style, "DPI", 60)  # coarse is enough here, and quick
    figure(scenes.make(kind, task), tmp_path / "scene.png")
    pixels = imread(tmp_path / "scene.png")[..., :3]
    assert pixels.shape[0] > 240 and pixels.shape[1] == 630
    assert 0.005 < np.mean(pixels < 0.9) < 0.5
    assert list(tmp_path.iterdir()) == [tmp_path / "scene.png"]


@pytest.mark.parametrize(("suffix", "start"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_vector_files_carry_no_date(suffix: str, start: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"scene.{suffix}"
    figure(scenes.make("compose", "point"), path)
    written = path.read_bytes()
    assert written.startswith(start)
    assert b"CreationDate" not in written and b"dc:date" not in written


def test_mean_paths_have_the_look_of_their_skill() -> None:
    scene = scenes.make("embed-means", "reach")
    lines = {line.get_label(): line for line in draw(scene).axes[0].lines}
    drawn = [line for line in lines.values() if len(line.get_xdata()) > 2]
    assert [(line.get_color(), line.get_linestyle()) for line in drawn] == [look(k)[:2] for k in range(8)]
    for skill, line in enumerate(drawn):
        assert np.allclose(line.get_xydata(), motion.path(scene, skill)[:, :2])


def test_an_executed_path_has_the_colour_of_each_piece() -> None:
    scene = scenes.make("compose", "reach")
    drawn = [line for line in draw(scene).axes[0].lines if len(line.get_xdata()) > 2]
    expected = [motion.piece_look(scene, 0, piece).color for piece in motion.pieces(scene, 0)]
    assert [line.get_color() for line in drawn] == expected


def test_a_mark_stands_where_a_limit_is_broken_first() -> None:
    scene = scenes.make("compose", "reach")
    drawn = draw(scenes.breaking(scene, 30))
    (mark,) = [line for line in drawn.axes[0].lines if line.get_marker() == subplots_space.VIOLATION]
    np.testing.assert_allclose(mark.get_xydata(), motion.path(scene, 0)[31:32, :2])
    named = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert "first beyond a safety limit" in named
    assert len(named) == 1 + len(draw(scene).legends[0].get_texts())


def test_the_nearest_passes_of_all_routes_stand_side_by_side() -> None:
    scene = scenes.make("compose", "reach")
    two = replace(
        scene,
        trajectories=scene.trajectories.select([0, 0]),
        waypoint_route=np.array([0, 0, 0, 1]),
        episode_route=np.array([0, 1]),
        episode_labels=("there 1", "there 2"),
    )
    drawn = draw(two)
    (panel,) = [axes for axes in drawn.axes if axes.get_title(loc="left") + axes.get_title() == "nearest pass while due"]
    (points,) = [line for line in panel.lines if line.get_linestyle() == "None" and len(line.get_xdata()) == 4]
    expected = 100 * np.concatenate([motion.closest(two, 0), motion.closest(two, 1)])
    assert len(motion.closest(two, 0)) == 3 and np.allclose(points.get_ydata(), expected)
    assert drawn.get_suptitle() == "reach/compose-v1   (n = 2 episodes, over time: there 1)"


def test_goals_that_fall_together_share_a_label() -> None:
    texts = [text.get_text() for text in draw(scenes.make("pretrain", "reach")).axes[0].texts]
    assert sorted(texts) == ["1, 3", "2, 4", "5, 7", "6, 8"]
    assert subplots_space.coincident(np.array([[0.0, 0], [1, 0], [0, 0.1]]), 0.2) == [[0, 2], [1]]


def test_the_title_says_what_and_how_many() -> None:
    drawn = draw(scenes.make("pretrain", "point", sampled=3))
    assert drawn.get_suptitle() == "point/pretrain-v1   (n = 4 skills at their mean latents, 12 sampled latents)"


def test_maps_share_limits_and_have_equal_scales() -> None:
    above, side = draw(scenes.make("pretrain", "reach")).axes[:2]
    assert above.get_xlim() == side.get_xlim()
    assert above.get_aspect() == side.get_aspect() == 1.0
    assert above.get_ylabel() == "y [m]" and side.get_ylabel() == "z [m]"


def test_a_transfer_counts_success_per_domain() -> None:
    scene = scenes.make("transfer-eval", "reach")
    won = {name: int(scene.trajectories.success[episodes].sum()) for name, episodes in motion.domains(scene).items()}
    assert titles(draw(scene))[:3] == [f"{name}: {count} of 6 succeed" for name, count in won.items()]


def test_panels_follow_what_was_recorded() -> None:
    assert titles(draw(scenes.make("pretrain", "point")))[-3:] == [
        "learning: success (black: mean)",
        "learning: final distance",
        "learning: return",
    ]
    assert not any(title.startswith("learning") for title in titles(draw(scenes.make("embed-means", "point"))))


def test_the_return_is_drawn_with_its_terms_where_they_were_kept() -> None:
    scene = scenes.rewarded(scenes.make("pretrain", "reach"))
    drawn = draw(scene)
    assert titles(drawn)[-1] == "learning: reward terms"
    *terms, total = drawn.axes[-1].lines
    np.testing.assert_allclose(sum(line.get_ydata() for line in terms), total.get_ydata())
    assert [line.get_label() for line in terms] == ["goal", r"pressed \$x\$"]
    alone = learning.reward_terms([scene])
    assert [len(axes.lines) for axes in alone.axes] == [3]


def test_an_unknown_format_lists_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        figure(scenes.make("compose", "point"), tmp_path / "scene.bmp")
    assert "png, pdf, svg" in caught.value.hint


def test_a_missing_folder_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SkillError, match=r"cannot write .*No such file or directory"):
        figure(scenes.make("compose", "point"), tmp_path / "nowhere" / "scene.png")


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.png"
    path.write_text("old")

    def full(self: Figure, stream: io.BytesIO, **_: object) -> None:
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(SkillError, match="No space left on device"):
        figure(scenes.make("compose", "point"), path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_settings_of_the_caller_are_left_alone(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    figure(scenes.make("compose", "point"), tmp_path / "scene.png")
    assert dict(matplotlib.rcParams) == before


def test_figures_need_neither_pyplot_nor_rerun() -> None:
    code = (
        "import sys, skillcli.viz.figures\n"
        "print([m for m in ('matplotlib.pyplot', 'rerun', 'torch', 'h5py') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_short_logarithmic_axis_has_plain_numbers() -> None:
    drawn = Figure()
    axes = drawn.subplots()
    axes.plot([0, 1], [4.8, 12.0])
    subplots_time._logarithmic(axes)
    drawn.draw_without_rendering()
    labels = [label.get_text() for label in axes.yaxis.get_ticklabels(which="both") if label.get_text()]
    assert {"6", "10"} <= set(labels) and all(float(label) for label in labels)
