"""Commands as a user and a program meet them: exit codes, one JSON object, one clear line, nothing left behind."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import CHAIN, TINY_SET, Result, files, made, skill
from worlds import SAWYER

from skillcli.recipe import recipe_names
from skillcli.simulation.domains import PRESETS
from skillcli.tasks.registry import ROOMS as DESCRIPTIONS


@pytest.fixture
def copy(chain: Path, tmp_path: Path) -> Path:
    """A store of one's own with the tiny chain in it."""
    return shutil.copytree(chain, tmp_path / "artifacts")


def check_failure(result: Result, code: int, *said: str) -> None:
    """One error object on stdout, one clear line and at most a hint on stderr."""
    assert result.code == code, result
    error = result.json["error"]
    assert error.keys() == {"type", "message", "hint"} and error["message"]
    assert len(result.out.splitlines()) == 1
    assert "Traceback" not in result.err and result.err.startswith("error: ") and len(result.err.splitlines()) <= 2
    for part in said:
        assert part in f"{error['message']} {error['hint']}", error


# what is typed, the exit code, what must be said
BAD = [
    (["pretrain", "raech"], 2, ["no recipe 'raech'", "reach"]),
    (["pretrain", "point", "--set", "training.speed=1"], 2, ["unknown recipe key 'training.speed'", "iterations"]),
    (["pretrain", "point", "--set", "training.simulations=-3"], 2, ["training.simulations", "-3"]),
    (["pretrain", "point", "--set", "training.learning_rate=nan"], 2, ["training.learning_rate"]),
    (["pretrain", "point", "--seed", "-1"], 2, ["--seed"]),
    (["pretrain", "point", "--threads", "-1"], 2, ["--threads"]),
    (["pretrain", "point", "--name", "../away"], 2, ["../away", "NAME of letters"]),
    (["pretrain", "--seed"], 2, ["--seed"]),
    (["prtrain"], 2, ["prtrain", "--help`"]),
    (["ls", "--nonsense"], 2, ["--nonsense", " ls --help`"]),
    (["pretrain", "--sed", "3"], 2, ["--seed", " pretrain --help`"]),
    (["recipes", "show"], 2, ["Missing argument", " recipes show --help`"]),
    (["robots", "shw"], 2, ["shw", " robots --help`"]),
    (["embed-means", "nobody/pretrain"], 1, ["no artifact 'nobody/pretrain'", "tiny"]),
    (["embed-means", "tiny/compose-v1"], 1, ["expected an artifact of kind pretrain", "tiny/pretrain"]),
    (["compose", "tiny/embed-means", "--goal", "nan,0,0.2"], 2, ["not finite", "--goal"]),
    (["compose", "tiny/embed-means", "--goal", "inf,0,0.2"], 2, ["finite"]),
    (["compose", "tiny/embed-means", "--goal", "2,0,0.2"], 2, ["out of reach", "1.34"]),
    (["compose", "tiny/embed-means", "--goal", "0.6,0,-0.2"], 2, ["below the table"]),
    (["compose", "tiny/embed-means", "--goal", "0.6"], 2, ["goal"]),
    (["compose", "tiny/embed-means", "--goal", "0.6,zero,0.2"], 2, ["zero"]),
    (["compose", "tiny/embed-means", "--task", "circle"], 2, ["no composition 'circle'", "triangle"]),
    (["compose", "tiny/embed-means", "--task", "triangle", "--goal", "0.6,0,0.2"], 2, ["not both"]),
    (["compose", "tiny/embed-means", "--method", "magic"], 2, ["no method 'magic'", "search"]),
    (["compose", "tiny/embed-means", "--set", "search.budget=0"], 2, ["search.budget"]),
    (["transfer-eval", "tiny/compose", "--domain", "mars"], 2, ["no domain 'mars'", "real-like"]),
    (["transfer-eval", "tiny/compose", "--robot", "nowhere.toml"], 2, ["nowhere.toml", "docs/robots.md"]),
    (["transfer-eval", "tiny/compose", "--episodes", "0"], 2, ["--episodes"]),
    (["transfer-eval", "tiny/compose", "--episodes", "-5"], 2, ["--episodes"]),
    (["show", "tiny/compose-v9"], 1, ["no artifact 'tiny/compose-v9'", "tiny/compose-v1"]),
    (["verify", "no such id"], 1, ["not an artifact id"]),
    (["rm", "tiny"], 1, ["not an artifact id"]),
    (["rm", "tiny/pretrain-v1"], 1, ["tiny/embed-means-v1", "remove what was made from it first"]),
    (["viz", "tiny/nothing"], 1, ["no artifact"]),
    (["recipes", "show", "raech"], 2, ["no recipe"]),
]  # fmt: skip


@pytest.mark.parametrize(("words", "code", "said"), BAD, ids=[" ".join(words) for words, _, _ in BAD])
def test_bad_input_ends_in_one_clear_line_and_leaves_the_store_as_it_was(
    chain: Path, words: list[str], code: int, said: list[str]
) -> None:
    before = files(chain)
    check_failure(skill("--store", chain, "--json", *words), code, *said)
    plain = skill("--store", chain, *words)
    assert (plain.code, plain.out) == (code, "") and plain.err.startswith("error: ") and "Traceback" not in plain.err
    assert files(chain) == before


@pytest.mark.parametrize("kind", CHAIN)
def test_an_empty_store_says_how_to_fill_it(tmp_path: Path, kind: str) -> None:
    words = {"pretrain": "embed-means", "embed-means": "compose", "compose": "transfer-eval", "transfer-eval": "show"}
    said = "make one with" if words[kind] in ("embed-means", "show") else "begin with"
    check_failure(skill("--store", tmp_path / "none", "--json", words[kind]), 1, "there is no artifact", said, " pretrain`")
    check_failure(skill("--store", tmp_path / "none", "--json", words[kind], "a"), 1, "no artifact 'a'", said, " pretrain`")
    assert not (tmp_path / "none").exists()


def test_what_is_missing_is_proposed_with_the_stage_that_can_run_now(tmp_path: Path, copy: Path) -> None:
    check_failure(skill("--store", tmp_path / "none", "--json", "compare", "a"), 1, "no artifact 'a'", " sweep RECIPE`")
    (copy / "tiny" / "transfer-eval-v1.h5").unlink()
    (copy / "tiny" / "compose-v1.h5").unlink()
    check_failure(skill("--store", copy, "--json", "transfer-eval"), 1, "no artifact of compose", "make one with", " compose`")


@pytest.mark.parametrize(
    "words",
    [
        ("compose", "tiny/transfer-eval"),
        ("execute", "tiny/transfer-eval"),
        ("export", "tiny/transfer-eval", "--onnx", "x.onnx"),
        ("play", "tiny/compose"),
        ("embed-means", "tiny/embed-means"),
    ],
)
def test_an_artifact_of_the_wrong_kind_has_one_exit_code_and_the_ones_that_fit_are_named(
    chain: Path, words: tuple[str, ...]
) -> None:
    check_failure(skill("--store", chain, "--json", *words), 1, "expected an artifact of kind", "available: tiny/")


@pytest.mark.parametrize("words", [["pretrain", "point"], ["run", "smoke"], ["ls"], ["show", "tiny/pretrain"]])
def test_a_store_that_cannot_be_written_or_read_is_said_before_the_work(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "artifacts").write_text("a file where the folder should be")
    check_failure(skill("--store", tmp_path / "artifacts", "--json", *words), 1, "artifacts")
    assert files(tmp_path) == {"artifacts"}


def test_a_failure_while_writing_leaves_nothing(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files(copy)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    check_failure(skill("--store", copy, "--json", "embed-means", "tiny/pretrain"), 1, "No space left")
    assert files(copy) == before


def test_an_unexpected_failure_is_one_line_too_and_a_traceback_on_request(chain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(*_: object) -> None:
        raise RuntimeError("surprise\nin two lines")

    monkeypatch.setattr("skillcli.store.store.Store.listing", defect)
    check_failure(skill("--store", chain, "--json", "ls"), 1, "surprise in two lines", "--debug")
    assert "RuntimeError: surprise" in skill("--store", chain, "--debug", "--json", "ls").err


def test_debug_shows_the_traceback_of_a_known_failure(chain: Path) -> None:
    assert "Traceback" in skill("--store", chain, "--debug", "show", "tiny/compose-v9").err
    assert "Traceback" not in skill("--store", chain, "show", "tiny/compose-v9").err


def test_ctrl_c_in_any_command_exits_130(chain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("skillcli.store.store.Store.read", pressed)
    check_failure(skill("--store", chain, "--json", "embed-means"), 130, "interrupted")


def test_ctrl_c_that_becomes_another_error_on_its_way_exits_130_too(chain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("skillcli.store.store.Store.listing", pressed)
    check_failure(skill("--store", chain, "--json", "ls"), 130, "interrupted")
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_while_the_program_is_loading_is_one_line() -> None:
    code = (
        "import signal, sys\n"
        "class Press:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'skillcli.cli.app': signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Press())\n"
        "sys.argv = ['skill', '--json', 'ls']\n"
        "from skillcli.cli.main import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    check_failure(Result(done.returncode, done.stdout, done.stderr), 130, "interrupted")


def test_the_store_is_listed_shown_and_verified(chain: Path) -> None:
    listed = made("--store", chain, "ls")["artifacts"]
    assert [one["id"] for one in listed] == [f"tiny/{stage}-v1" for stage in CHAIN]
    assert {"id", "kind", "created_utc", "bytes", "parents"} <= listed[0].keys()
    assert listed[1]["parents"] == ["tiny/pretrain-v1"]
    shown = made("--store", chain, "show", "tiny/compose")
    assert {"id", "kind", "content_sha256", "recipe", "seed", "parents", "packages"} <= shown.keys()
    assert shown["parents"][0]["id"] == "tiny/embed-means-v1" and shown["recipe"]["task"]["horizon"] == 16
    assert made("--store", chain, "verify", "tiny/pretrain") == {"id": "tiny/pretrain-v1", "ok": True, "problems": []}
    for words in (["ls"], ["show", "tiny/compose"], ["verify", "tiny/compose"]):
        assert "tiny/" in skill("--store", chain, *words).out


def test_a_damaged_artifact_fails_verification_with_exit_code_1(copy: Path) -> None:
    path = copy / "tiny" / "compose-v1.h5"
    path.chmod(0o644)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    result = skill("--store", copy, "--json", "verify", "tiny/compose-v1")
    assert result.code == 1 and result.json["ok"] is False and result.json["problems"]


def test_removing_goes_from_the_end_of_the_chain(copy: Path) -> None:
    assert skill("--store", copy, "rm", "tiny/compose-v1").code == 1
    for stage in reversed(CHAIN):
        assert made("--store", copy, "rm", f"tiny/{stage}-v1")["removed"] is True
    assert made("--store", copy, "ls")["artifacts"] == []


def test_without_an_id_the_newest_that_fits_is_taken_and_named(copy: Path) -> None:
    result = skill("--store", copy, "embed-means")
    assert result.code == 0 and "using tiny/pretrain-v1" in result.err and "tiny/embed-means-v2" in result.out
    assert "taking" not in skill("--store", copy, "--quiet", "show").err


def test_the_stages_one_by_one_report_the_promised_keys(copy: Path) -> None:
    means = made("--store", copy, "embed-means", "tiny/pretrain", "--name", "other")
    assert means["id"] == "other/embed-means-v1"
    assert {"id", "skills", "latent_goal_correlation", "efficiency"} <= means.keys()
    assert {"name", "mean", "std", "final_distance_m"} <= means["skills"][0].keys()

    plan = made("--store", copy, "compose", "other", "--goal", "0.6,0.1,0.2", "--goal", "0.55,0,0.2")
    wanted = {"id", "method", "task", "success", "planning_seconds", "expanded_nodes", "simulated_robot_seconds", "segments"}
    assert wanted | {"waypoints", "final_distance_m"} <= plan.keys()
    assert [waypoint["target"] for waypoint in plan["waypoints"]] == [[0.6, 0.1, 0.2], [0.55, 0, 0.2]]
    assert {"skill", "latent", "seconds"} <= plan["segments"][0].keys()

    moved = made("--store", copy, "transfer-eval", "other/compose", "--domain", "mild", "--domain", "mild", "--episodes", "2")
    assert {"success_rate", "episodes"} <= moved["source"].keys()
    (domain,) = moved["domains"]
    assert domain.keys() >= {"name", "episodes", "successes", "success_rate", "ci95", "final_distance_m", "retention"}
    assert domain["final_distance_m"].keys() >= {"mean", "median", "p90"} and domain["episodes"] == 2


def test_a_robot_is_named_with_its_notes_and_the_table_shows_what_matters(copy: Path) -> None:
    robot = Path(__file__).parent.parent / "robots" / "meshes.toml"
    words = ("--store", copy, "transfer-eval", "tiny/compose", "--domain", "latency-40", "--episodes", "2", "--robot", robot)
    told = skill(*words, "--sensitivity")
    assert told.code == 0, told.err
    assert "meshes.toml: " in told.err and "on the robot of meshes.toml" in told.out
    for part in ("gap", "replay", "latency-40: alone", "farthest off: latency-40 ", "viz tiny/transfer-eval-v2 --open "):
        assert part in told.out, told.out
    found = made(*words)
    assert found["robot"]["notes"] and found["robot"]["fingerprint"] and "sensitivity" not in found["domains"][0]


@pytest.mark.parametrize("replan", [(), ("--replan",)])
def test_the_point_has_no_robot_to_replace(tmp_path: Path, replan: tuple[str, ...]) -> None:
    store = shutil.copytree(
        Path(__file__).parents[2] / "artifacts" / "reference-point", tmp_path / "a" / "reference-point"
    ).parent
    before, robot = files(store), Path(__file__).parent.parent / "robots" / "servo.toml"
    refused = skill("--store", store, "--json", "transfer-eval", "reference-point/compose", "--robot", robot, *replan)
    check_failure(refused, 2, "the point task has no robot to replace")
    assert files(store) == before


def test_a_plan_that_breaks_a_limit_is_told_with_what_to_do(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skillcli.tasks.world.load_robot", lambda _: replace(SAWYER, speed_limit=np.full(7, 0.01)))
    told = skill("--store", copy, "compose", "tiny/embed-means", "--method", "sequence", "--plan", "1:0.2")
    assert told.code == 0 and "failed, ends" in told.out and "violates joint_speed in route 1 for" in told.out
    said = " ".join(told.err.split())
    assert "violates a safety limit" in said and "viz tiny/compose-v2 --open` shows it" in said


def test_finished_stages_are_used_again_until_an_input_changes(chain: Path, copy: Path) -> None:
    def reused(*changes: str) -> list[bool]:
        words = [word for change in changes for word in ("--set", change)]
        report = made("--store", copy, "run", "smoke", "--name", "tiny", *TINY_SET, *words)
        return [report[stage]["reused"] for stage in CHAIN]

    assert reused() == [True] * 4
    assert files(copy) == files(chain)
    assert reused("transfer.episodes=2") == [True, True, True, False]
    assert reused("search.batch=3") == [True, True, False, False]


@pytest.mark.parametrize("kind", CHAIN)
def test_every_kind_becomes_a_recording_and_a_figure(chain: Path, tmp_path: Path, kind: str) -> None:
    rrd, png = tmp_path / "a.rrd", tmp_path / "a.png"
    report = made("--store", chain, "viz", f"tiny/{kind}", "-o", rrd, "--png", png)
    assert report["id"] == f"tiny/{kind}-v1" and (report["rrd"], report["png"]) == (str(rrd), str(png))
    assert len(report["entities"]) > 10
    assert rrd.read_bytes()[:4] == b"RRF2" and rrd.stat().st_size > 50_000
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and png.stat().st_size > 20_000


@pytest.mark.slow  # every recipe is resolved
def test_what_is_available_is_listed() -> None:
    assert [recipe["name"] for recipe in made("recipes")["recipes"]] == recipe_names()
    shown = made("recipes", "show", "reach", "--set", "training.iterations=7")
    assert shown["recipe"]["training"]["iterations"] == 7 and len(shown["sha256"]) == 64
    assert {task["name"] for task in made("tasks")["tasks"]} == set(DESCRIPTIONS)
    assert [domain["name"] for domain in made("domains")["domains"]] == list(PRESETS)
    for words in (["recipes"], ["recipes", "show", "reach"], ["tasks"], ["domains"]):
        assert "reach" in skill(*words).out or words == ["domains"]


def test_one_domain_is_shown_with_units_and_meaning_also_from_a_file(tmp_path: Path) -> None:
    shown = made("domains", "latency-40")["domain"]
    assert shown["parameters"]["latency"]["range"] == "0.04" and shown["parameters"]["latency"]["unit"] == "s"
    own = tmp_path / "worn.toml"
    own.write_text('name = "worn"\ndescription = "a [worn] arm"\nextends = "latency-40"\n[parameters]\ngain = 0.8\n')
    assert made("domains", own)["domain"]["parameters"].keys() == {"latency", "gain"}
    assert "a [worn] arm" in skill("domains", str(own)).out
    own.write_text('name = "worn"\n[parameters]\ngian = 0.8\n')
    refused = skill("domains", str(own))
    assert refused.code == 2 and "did you mean 'gain'" in refused.err and refused.out == ""


def test_doctor_finds_this_machine_healthy_and_leaves_nothing(tmp_path: Path) -> None:
    report = made("--store", tmp_path / "artifacts", "doctor")
    assert report["ok"] and "equal with 1 and 2 threads" in json.dumps(report)
    assert files(tmp_path) == set()


def test_version_and_help() -> None:
    assert skill("--version").out.startswith("skill ")
    for words in ([], ["pretrain"], ["recipes", "show"]):
        result = skill(*words, "--help")
        assert result.code == 0 and "Usage" in result.out and result.err == ""
