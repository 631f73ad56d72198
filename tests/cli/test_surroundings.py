"""`skill` as a process in odd places: encodings, streams that are full or closed, environments, signals."""

from __future__ import annotations

import json
import os
import resource
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from command import TELLING, TINY_SET, files, made, skill
from pytest import MonkeyPatch

from skillcli import stopping
from skillcli.cli import trouble, typed
from skillcli.cli.main import set_aside
from skillcli.viz import figure_style

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parent.parent / "store" / "golden"
COMMAND = (sys.executable, "-c", "import sys; sys.argv[0] = 'skill'; from skillcli.cli.main import main; main()")


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return shutil.copytree(GOLDEN, tmp_path / "artifacts")


def run(*words: str | Path, env: Mapping[str, str] = {}, **options: Any) -> subprocess.CompletedProcess[str]:
    """A process of its own."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **env}
    return subprocess.run([*COMMAND, *map(str, words)], text=True, errors="replace", timeout=120, env=environment, **streams)


@pytest.mark.parametrize("words", [["show", "tiny/transfer-eval"], ["show", "tiny/nobody"], ["ls"], ["domains"]])
def test_what_cannot_be_encoded_is_replaced(store: Path, words: list[str]) -> None:
    plain, ascii_ = (run("--store", store, *words, env={"PYTHONIOENCODING": name}) for name in ("utf-8", "ascii"))
    assert ascii_.returncode == plain.returncode and (ascii_.stdout + ascii_.stderr).isascii()
    assert len(ascii_.stdout.splitlines()) == len(plain.stdout.splitlines())


def test_a_locale_without_letters_still_finds_its_files(tmp_path: Path) -> None:
    store = shutil.copytree(GOLDEN, tmp_path / "größe")
    old = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = run("--store", store, "verify", "tiny/compose", env=old)
    assert done.returncode == 0, done.stderr
    assert run("--store", tmp_path / "nö", "ls", env=old).returncode == 1


@pytest.mark.parametrize("words", [["--json", "ls"], ["ls"], ["--help"], ["--version"]])
def test_a_full_disk_behind_stdout_is_one_line(store: Path, words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = run("--store", store, *words, stdout=full)
    assert done.returncode == 1 and done.stderr.startswith("error: cannot write to stdout: No space left")
    assert len(done.stderr.splitlines()) == 2


def test_a_reader_that_has_seen_enough_is_no_failure(store: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = run("--store", store, "embed-means", "reference-point/nobody", stdout=write)
    assert done.returncode == 1 and "no artifact" in done.stderr
    done = run("--store", store, "verify", "tiny/compose", stdout=write, stderr=write)
    os.close(write)
    assert done.returncode == 0


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_failure_and_nothing_else_takes_their_place(store: Path, closed: str) -> None:
    line = f"{shlex.join([*COMMAND, '--store', str(store), 'migrate', 'reference-point/compose-v1'])} {closed}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert made("--store", store, "verify", "reference-point/compose-v2")["ok"]


@pytest.mark.parametrize("text", ["0", "1", "-5", "abc", "٣٠", "99999999999"])
def test_a_size_that_no_terminal_has_is_not_believed(text: str, monkeypatch: MonkeyPatch) -> None:
    for name in ("COLUMNS", "LINES", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, text)
    set_aside()
    assert not {"COLUMNS", "LINES", "TERMINAL_WIDTH"} & os.environ.keys()
    monkeypatch.setenv("COLUMNS", "60")
    set_aside()
    assert os.environ["COLUMNS"] == "60" and os.environ["MUJOCO_GL"] == "disable"


def test_tables_are_there_whatever_columns_says(store: Path) -> None:
    assert "tiny/compose-v1" in run("--store", store, "ls", env={"COLUMNS": "0"}).stdout


def test_pictures_do_not_depend_on_settings_of_ones_own(chain: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    (mine / "matplotlib").mkdir(parents=True)
    rules = "text.usetex: True\nfont.size: 30\nfigure.figsize: nonsense\nbackend: gtk4agg\nsavefig.bbox: tight\n"
    (mine / "matplotlibrc").write_text(rules)
    (mine / "matplotlib" / "matplotlibrc").write_text(rules)
    theirs = {
        "MPLBACKEND": "module://nobody.inline",
        "XDG_CONFIG_HOME": str(mine),
        "MPLCONFIGDIR": "/proc/none",
        "MUJOCO_GL": "osmesa",
    }
    words = ("--store", chain, "viz", "tiny/compose", "-o", tmp_path / "a.rrd", "--png")
    odd = run(*words, tmp_path / "odd.png", env={**theirs, "RUST_LOG": "debug"}, cwd=mine)
    assert odd.returncode == 0 and odd.stderr == "", odd.stderr
    made(*words, tmp_path / "plain.png")
    assert (tmp_path / "odd.png").read_bytes() == (tmp_path / "plain.png").read_bytes()


@pytest.mark.parametrize("words", [["viz", "-o", "a.rrd"], ["viz", "-o", "a.rrd", "--png", "a.png"], ["report"]])
def test_a_disk_that_fills_while_drawing_leaves_nothing(
    chain: Path, tmp_path: Path, words: list[str], monkeypatch: MonkeyPatch
) -> None:
    monkeypatch.setattr(figure_style, "DPI", 40)
    monkeypatch.chdir(tmp_path)
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (9_000, most))
    try:
        done = skill("--store", chain, words[0], "tiny/embed-means-v1", *words[1:])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert done.code == 1 and done.err.startswith("error: cannot write ") and len(done.err.splitlines()) <= 12, done.err
    assert list(tmp_path.iterdir()) == []


def test_opening_a_window_without_a_display_is_refused_before_the_work(
    chain: Path, tmp_path: Path, monkeypatch: MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    refused = skill("--store", chain, "--json", "viz", "tiny/compose", "-o", tmp_path / "a.rrd", "--open")
    assert refused.code == 1 and "no display" in refused.json["error"]["message"] and "--web" in refused.json["error"]["hint"]
    assert not (tmp_path / "a.rrd").exists()


def test_the_end_of_a_served_recording_is_no_failure(chain: Path, tmp_path: Path, monkeypatch: MonkeyPatch) -> None:
    class Server:
        ended = False

        def wait(self) -> None:
            if not self.ended:
                raise KeyboardInterrupt

        def terminate(self) -> None:
            self.ended = True

    server = Server()
    monkeypatch.setattr("skillcli.viz.viewer.serve_web", lambda _: server)
    assert made("--store", chain, "viz", "tiny/compose", "-o", tmp_path / "a.rrd", "--web")["rrd"] and server.ended


# --- signals ----------------------------------------------------------------------------------------------------------


def started(store: Path, program: str, **options: Any) -> subprocess.Popen[str]:
    words = ["--store", str(store), "--json", "pretrain", "point", "--set", "training.iterations=100000"]
    return subprocess.Popen([sys.executable, "-c", program, *words], stdout=-1, stderr=-1, text=True, **options)


@pytest.mark.parametrize("sent", [[signal.SIGTERM], [signal.SIGHUP, signal.SIGHUP, signal.SIGTERM]])
def test_a_scheduler_or_a_lost_terminal_stops_it_as_ctrl_c_does(tmp_path: Path, sent: list[signal.Signals]) -> None:
    process = started(tmp_path, TELLING)
    assert process.stderr is not None and process.stderr.readline() == "iterating\n"
    for each in sent:
        process.send_signal(each)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130 and json.loads(out)["error"]["type"] == "Interrupted", err
    assert f"skill --store {tmp_path} pretrain point" in json.loads(out)["error"]["hint"]
    assert [".checkpoint-pretrain" in name for name in files(tmp_path)] == [True]


def test_nohup_means_what_it_says() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert signal.SIGHUP not in stopping.heeded() and signal.SIGTERM in stopping.heeded()
        with stopping.stoppable() as stop:
            signal.raise_signal(signal.SIGHUP)
        assert not stop.requested
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_second_request_stops_at_once_and_an_echo_is_none() -> None:
    with stopping.stoppable() as stop:
        for sent in (signal.SIGHUP, signal.SIGHUP, signal.SIGTERM):
            signal.raise_signal(sent)
        assert stop.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_request_during_the_last_save_is_not_lost(tmp_path: Path, monkeypatch: MonkeyPatch) -> None:
    from skillcli.stages import pretrain

    save = pretrain.save_checkpoint

    def asked(*given: Any) -> None:
        save(*given)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(pretrain, "save_checkpoint", asked)
    words = ("pretrain", "smoke", *TINY_SET)
    stopped = skill("--store", tmp_path, "--json", *words)
    assert stopped.code == 130 and "before evaluation" in stopped.json["error"]["message"]
    monkeypatch.undo()
    assert made("--store", tmp_path, *words, "--resume")["id"] == "smoke/pretrain-v1"


@pytest.mark.parametrize(("stage", "source"), [("embed-means", "pretrain"), ("transfer-eval", "compose")])
def test_a_stage_that_keeps_nothing_says_so(chain: Path, stage: str, source: str, monkeypatch: MonkeyPatch) -> None:
    def pressed(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("skillcli.store.store.Store.check_writable", pressed)
    monkeypatch.setattr("skillcli.stages.embed_means.open_library", pressed)
    stopped = skill("--store", chain, "--json", stage, f"tiny/{source}")
    assert stopped.code == 130 and f"nothing of this {stage} was kept" in stopped.json["error"]["message"]


# --- commands that are proposed ---------------------------------------------------------------------------------------


def test_options_for_every_command_may_stand_behind_it(store: Path) -> None:
    assert len(skill("ls", "--json", "--store", store).json["artifacts"]) == 9
    assert skill("show", "tiny/nobody", f"--store={store}", "--json").json["error"]["type"] == "UnknownArtifact"
    assert typed.split(["a", "--json", "--", "--json"]) == (["--json"], ["a", "--", "--json"])


def test_a_proposed_command_reaches_the_same_store(chain: Path, tmp_path: Path, monkeypatch: MonkeyPatch) -> None:
    odd = shutil.copytree(chain, tmp_path / "my 'store'")
    told = skill("--store", odd, "embed-means", "tiny/pretrain")
    proposal = next(line for line in told.out.splitlines() if line.startswith("next: ")).removeprefix("next: ")
    assert shlex.split(proposal)[:4] == ["skill", "--store", str(odd), "compose"]
    assert skill(*shlex.split(proposal)[1:], "--help").code == 0
    monkeypatch.setattr(sys, "argv", ["skill", "ls"])
    assert typed.runnable("`skill verify --all` or skill ls") == "`skill verify --all` or skill ls"


def test_a_proposed_command_starts_this_program(tmp_path: Path, monkeypatch: MonkeyPatch) -> None:
    ours, other = tmp_path / "venv" / "skill", tmp_path / "bin" / "skill"
    for path in (ours, other):
        path.parent.mkdir()
        path.write_text("#!/bin/sh\n")
        path.chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(ours), "gc"])
    monkeypatch.setenv("PATH", str(other.parent))
    assert typed.runnable("`skill gc --apply`") == f"`{ours} gc --apply`"
    monkeypatch.setenv("PATH", str(ours.parent))
    assert typed.runnable("`skill gc --apply`") == "`skill gc --apply`"


# --- stores, disks and memory -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["ls"], ["verify", "--all"], ["gc"], ["unlock"]])
def test_a_store_that_was_named_and_is_not_there_is_said(tmp_path: Path, words: list[str], monkeypatch: MonkeyPatch) -> None:
    refused = skill("--store", tmp_path / "typo", "--json", *words)
    assert refused.code == 1 and "there is no store" in refused.json["error"]["message"]
    monkeypatch.setenv("SKILL_STORE", str(tmp_path / "typo"))
    assert skill(*words).code == 1
    monkeypatch.delenv("SKILL_STORE")
    monkeypatch.chdir(tmp_path)
    usual = skill(*words)
    assert usual.code == 0 and "there is no store artifacts here" in usual.err and list(tmp_path.iterdir()) == []


def test_strangers_in_a_store_are_named_and_pictures_of_a_run_are_none(store: Path) -> None:
    for name in ("notes.txt", "tiny/pretrain-v1.h5.bak", "tiny/compose.rrd", "tiny/pretrain.png"):
        (store / name).touch()
    found = skill("--store", store, "--json", "verify", "--all").json["strangers"]
    assert found == [str(store / "notes.txt"), str(store / "tiny" / "pretrain-v1.h5.bak")]
    assert "notes.txt" in skill("--store", store, "verify", "--all").err


def test_a_folder_that_is_gone_under_ones_feet_is_said(tmp_path: Path) -> None:
    line = f"mkdir gone && cd gone && rmdir ../gone && {shlex.join([*COMMAND, 'ls'])}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert done.returncode == 1 and "no longer exists" in done.stderr and "cd to an existing" in done.stderr


def test_doctor_leaves_no_folder(tmp_path: Path) -> None:
    assert skill("--store", tmp_path / "none", "doctor").code == 0 and list(tmp_path.iterdir()) == []


FAILURES: Sequence[tuple[Exception, str, str]] = (
    (MemoryError(), "not enough memory", "ulimit -v"),
    (
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 8 bytes"),
        "not enough memory",
        "ulimit -v",
    ),
    (ImportError("libtorch.so: failed to map segment from shared object"), "not enough memory", "ulimit -v"),
    (ImportError("libtorch.so: no such file"), "a package cannot be loaded: libtorch.so", "make install"),
    (OSError(5, "Input/output error", "/mnt/x"), "/mnt/x: Input/output error", "the disk"),
    (OSError(5, "Input/output error"), "Input/output error", "the disk"),
    (ZeroDivisionError("division by zero"), "unexpected: division by zero", "a defect of skill"),
)


@pytest.mark.parametrize(("error", "message", "hint"), FAILURES)
def test_failures_of_disk_and_machine_have_their_names(error: Exception, message: str, hint: str) -> None:
    said = trouble.explain(error)
    assert message in said[0] and hint in said[1]
