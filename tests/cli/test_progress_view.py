"""What is seen of long work: on terminals of any width, in pipes, and in TensorBoard."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest
from command import TINY_SET, made, skill
from rich.console import Console

from skillcli.cli import progress_view
from skillcli.cli.session import Session
from skillcli.progress import Progress

SMALL = ("pretrain", "smoke", *TINY_SET, "--set", "training.iterations=4")
MANY = {f"{'a long name of ' * (k % 2)}skill {k}": k / 19 for k in range(20)}
FULL = Progress("pretrain", 30, 60, "iterations", 18432.4, MANY, "final distance 0.123 m", 0.934)


def shown(progress: Progress, width: int, **options: bool) -> list[str]:
    console = Console(width=width, file=io.StringIO(), **options)
    console.print(progress_view.panel(progress, "0:34"))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_the_panel_fits_and_shows_every_skill(width: int) -> None:
    lines = shown(FULL, width)
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert text.count("%") == 20 + 2, "20 skills, their mean and the share of raw physics"
    assert lines[0].strip() == "pretrain 30/60 iterations · 0:34 left" and lines[1].strip() == "━" * 20 + "╌" * 20
    assert width == 40 or lines[2].strip() == "18,432 steps/s · 93% of raw physics"
    assert width == 40 or len(lines) <= 16, "it fits a small terminal"


def test_a_bar_says_in_signs_and_numbers_what_it_says_in_colours() -> None:
    assert progress_view.skill_bar("up", 0.5, 4).plain == "up   ━━━╌╌╌  50%"
    assert progress_view.skill_bar("a long name", 1.0, 6).plain == "a lon… ━━━━━━ 100%"


def test_without_colour_nothing_is_coloured(monkeypatch: pytest.MonkeyPatch) -> None:
    assert any("\x1b[32m" in line for line in shown(FULL, 80, force_terminal=True))
    monkeypatch.setenv("NO_COLOR", "1")
    assert not any("\x1b[3" in line for line in shown(FULL, 80, force_terminal=True))


def test_nothing_is_said_of_what_was_not_measured() -> None:
    assert shown(Progress("compose", 3, 10, "nodes"), 60)[0].strip() == "compose 3/10 nodes · 0:34 left"
    assert not any("physics" in line or "success" in line for line in shown(Progress("compose", 3, 10, "nodes"), 60))


def test_a_pipe_gets_a_plain_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(progress_view.time, "monotonic", lambda: now)
    console = Console(width=60, file=io.StringIO())
    on_progress = progress_view.plain(console)
    for now in range(41):
        on_progress(Progress("pretrain", now, 60, "iterations", 1000.0, {"[up]": 0.5}, "note", 0.9))
    assert isinstance(console.file, io.StringIO)
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 4 and "\x1b" not in console.file.getvalue()
    assert lines[0] == "pretrain 10/60 iterations · 0:50 left · 1,000 steps/s · 90% of raw physics · success 50% · note"


def test_the_time_left_does_not_rise_while_a_unit_of_work_takes_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(progress_view.time, "monotonic", lambda: now)
    clock, left = progress_view.Clock(), []
    for now in range(0, 95, 5):  # ten seconds for each of ten episodes, but forty for the third
        done = min(now // 10, 2) if now < 60 else 3 + (now - 60) // 10
        left.append(clock.left(Progress("transfer-eval", int(done), 10, "episodes")))
    assert left[:4] == ["?", "?", "1:30", "1:25"] and left[4:12] == ["1:20", "1:15", *["1:10"] * 6]
    assert left[12:14] == ["2:20", "2:15"], "then what it took counts"
    for now in (100, 130, 200):  # noqa: B007 - the clock reads it
        assert clock.left(Progress("transfer-eval", 10, 10, "episodes")) == "0:00", "the last results are being written"


@pytest.mark.parametrize("quiet", [False, True])
@pytest.mark.slow
def test_a_pipe_gets_no_control_characters_and_nothing_when_quiet(
    quiet: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress_view, "PLAIN_SECONDS", 0.0)
    result = skill("--store", tmp_path, *(["--quiet"] if quiet else []), *SMALL)
    assert result.code == 0 and "\x1b" not in result.err + result.out
    assert (result.err == "") is quiet
    assert quiet or ("pretrain 4/4 iterations" in result.err and "of raw physics" in result.err)


def test_a_dumb_terminal_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, _environ={"TERM": "dumb"})
    monkeypatch.setattr(Session, "err", property(lambda _: console))
    with Session(Path()).progress() as on_progress:
        on_progress(FULL)
    assert isinstance(console.file, io.StringIO)
    assert "\x1b" not in console.file.getvalue()


@pytest.mark.parametrize("words", [("ls",), ("show", "tiny/pretrain"), ("show", "tiny/transfer-eval")])
@pytest.mark.parametrize("width", [60, 200])
def test_tables_fit_and_never_cut_an_id(
    words: tuple[str, ...], width: int, chain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    result = skill("--store", chain, *words)
    assert result.code == 0 and max(map(len, result.out.splitlines())) <= width
    assert "tiny/pretrain-v1" in result.out
    assert words != ("ls",) or ("smoke" in result.out) is (width == 200), "what matters less goes first"


def scalars(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """What TensorBoard would draw, (step, value) by name."""
    loading = pytest.importorskip("tensorboard.backend.event_processing.event_multiplexer")
    reader = loading.EventMultiplexer().AddRunsFromDirectory(str(folder)).Reload()
    tensors = pytest.importorskip("tensorboard.util.tensor_util")
    (run,) = reader.Runs()
    return {
        tag: [(event.step, float(tensors.make_ndarray(event.tensor_proto))) for event in reader.Tensors(run, tag)]
        for tag in reader.Runs()[run]["tensors"]
    }


def test_tensorboard_gets_the_curves_over_control_steps_and_changes_nothing(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    made("--store", tmp_path, *SMALL, "--name", "plain")
    made("--store", tmp_path, *SMALL, "--name", "watched", "--tensorboard", tmp_path / "board")
    one, two = (made("--store", tmp_path, "show", f"{name}/pretrain-v1") for name in ("plain", "watched"))
    assert one["content_sha256"] == two["content_sha256"]
    found = scalars(tmp_path / "board")
    assert {f"curves/{name}" for name in found} == {name for name in two["arrays"] if name.startswith("curves/")} - {
        "curves/env_steps"
    }
    steps = [step for step, _ in found["return"]]
    assert steps == [two["results"]["env_steps"] * k // 4 for k in (1, 2, 3, 4)]


def test_tensorboard_goes_on_at_the_right_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("tensorboard")
    from test_training import interrupt_after

    board = ("--tensorboard", tmp_path / "board")
    with monkeypatch.context() as patch:
        interrupt_after(patch, 2)
        assert skill("--store", tmp_path, *SMALL, *board).code == 130
    total = made("--store", tmp_path, *SMALL, *board, "--resume")["env_steps"]
    assert [step for step, _ in scalars(tmp_path / "board")["return"]] == [total * k // 4 for k in (1, 2, 3, 4)]


def test_without_tensorboard_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tensorboard.summary", None)
    result = skill("--store", tmp_path / "store", "--json", *SMALL, "--tensorboard", tmp_path / "board")
    assert result.code == 1 and "skillcli[tensorboard]" in result.json["error"]["hint"]
    assert not (tmp_path / "store" / "smoke").exists(), "before anything was trained"


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    (tmp_path / "file").touch()
    result = skill("--store", tmp_path, *SMALL, "--tensorboard", tmp_path / "file" / "board")
    assert result.code == 1 and "cannot write" in result.err
