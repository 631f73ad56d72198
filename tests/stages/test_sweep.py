"""Sweeps: cells as ordinary artifacts, used again, resumed after a kill, with failures kept."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import TINY_SET, made, skill

from skillcli.errors import UsageError
from skillcli.kinds import SWEEP
from skillcli.kinds.sweep import sha_text, sha_words
from skillcli.store import ArtifactId, Store
from skillcli.sweeps.plan import SweepPlan

pytestmark = pytest.mark.slow  # trains, in processes of its own


def test_cells_are_ordinary_artifacts_and_are_used_again(tmp_path: Path) -> None:
    root = tmp_path / "store"
    by_hand = made("--store", root, "pretrain", "smoke", *TINY_SET, "--seed", "1", "--set", "training.iterations=3")
    asked = (
        "sweep",
        "smoke",
        "--seeds",
        "0-1",
        *TINY_SET[2:],
        "--set",
        "training.iterations=2,3",
        "--name",
        "grid",
        "--jobs",
        "2",
    )
    first = made("--store", root, *asked)
    assert first["failed"] == 0 and [(cell["seed"], cell["settings"]["training.iterations"]) for cell in first["cells"]] == [
        (0, 2), (1, 2), (0, 3), (1, 3),
    ]  # fmt: skip
    assert [cell["reused"] for cell in first["cells"]] == [False, False, False, True]
    assert first["cells"][3]["id"] == by_hand["id"], "what was made by hand is used too"
    store = Store(root)
    sweep = store.read(ArtifactId.parse(first["id"]))
    contents = [store.header(ArtifactId.parse(cell["id"])).content_sha256 for cell in first["cells"]]
    assert [sha_text(words) for words in sweep.arrays["cells/content"]] == contents
    again = made("--store", root, *asked)
    assert again["id"] == first["id"] and again["reused"] == 4
    for key in ("id", "metrics"):
        assert [cell[key] for cell in again["cells"]] == [cell[key] for cell in first["cells"]]
    assert all("success_rate" in cell["metrics"] for cell in again["cells"])
    assert made("--store", root, "verify", "--all")["ok"]
    assert "training.iterations=3" in skill("--store", root, "show", "grid/sweep").out
    _check_that_a_sweep_travels_with_its_cells(root, first, tmp_path)


def _check_that_a_sweep_travels_with_its_cells(root: Path, sweep: dict[str, Any], tmp_path: Path) -> None:
    remote, other = f"file://{tmp_path}/remote", tmp_path / "other"
    cells = {cell["id"] for cell in sweep["cells"]}
    told = skill("--store", root, "upload", remote, "grid/sweep")
    assert told.code == 0 and all(f"transferred: {one}" in told.out for one in (*cells, sweep["id"])), told.out + told.err
    told = skill("--store", root, "upload", remote, "grid/sweep")
    assert "0 transferred" in told.out and f"already there: {sweep['id']}" in told.out
    got = made("--store", other, "download", remote, "grid/sweep")
    assert set(got["transferred"]) == {*cells, sweep["id"]} and made("--store", other, "verify", "--all")["ok"]
    (root / f"{sweep['cells'][0]['id']}.h5").unlink()
    told = skill("--store", root, "upload", f"file://{tmp_path}/third", "grid/sweep")
    assert told.code == 0 and "not here: 1; run the sweep again" in told.out and "4 transferred" in told.out


def test_a_killed_sweep_goes_on_where_it_was(tmp_path: Path) -> None:
    root = tmp_path / "store"
    asked = ["--store", str(root), "--json", "sweep", "smoke", "--seeds", "0-1", *TINY_SET[2:]]
    asked += ["--set", "training.iterations=3", "--name", "killed", "--jobs", "1"]
    code = "import sys; sys.argv[0] = 'skill'; from skillcli.cli.main import main; main()"
    process = subprocess.Popen([sys.executable, "-c", code, *asked], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while not list(root.glob("killed*/pretrain-v1.h5")) and time.monotonic() < until:
        time.sleep(0.05)
    process.kill()
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in root.glob("killed*/pretrain-v1.h5")}
    found = made(*asked[:2], *asked[3:])
    assert found["failed"] == 0 and found["reused"] >= 1 and len(before) >= 1
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert len(list(root.glob("killed*/pretrain-v*.h5"))) == 2, "none is there twice"


def test_failures_are_kept_with_their_line(tmp_path: Path) -> None:
    root = tmp_path / "store"
    places = "task.goals=[[0.6,0.1,0.25]],[[9.0,0.0,0.2]]"
    asked = ("sweep", "smoke", "--seeds", "0", *TINY_SET, "--set", places, "--name", "odd")
    found = made("--store", root, *asked)
    assert [cell["state"] for cell in found["cells"]] == ["done", "failed"] and found["failed"] == 1
    assert "reach" in found["cells"][1]["message"]
    stored = SWEEP.results_of(Store(root).read(ArtifactId.parse(found["id"])))
    assert stored.failed == 1 and stored.failures[0].message == found["cells"][1]["message"]
    told = skill("--store", root, *asked)
    assert told.code == 0 and "failed: task.goals" in told.err and "1 were there already" in told.out
    compared = skill("--store", root, "compare", "odd/sweep", "--metric", "speed")
    assert compared.code == 2 and "success_rate" in compared.err


def test_of_a_sweep_without_a_finished_run_it_is_said_where_the_reasons_are(tmp_path: Path) -> None:
    root = tmp_path / "store"
    told = skill("--store", root, "sweep", "smoke", "--seeds", "0", "--set", "task.goals=[[9.0,0.0,0.2]]", "--name", "none")
    assert told.code == 0 and "1 failed" in told.out and "next:" not in told.out
    for words in (("compare",), ("viz",)):
        refused = skill("--store", root, *words, "none/sweep")
        assert refused.code == 2 and "no run is finished" in refused.err and "show ID` of the sweep" in refused.err


def test_what_would_fail_in_every_cell_is_refused_before(tmp_path: Path) -> None:
    for words, told in (
        (("--set", "training.iteration=2"), "training.iteration"),
        (("--set", "training.iterations=2,-1"), "training.iterations"),
        (("--through", "report"), "--through"),
        (("--seeds", "3-1"), "--seeds"),
        (("--grid", "--random", "2", "--set", "training.iterations=2,3"), "--grid"),
        (("--random", "2", "--optuna", "2"), "leave out --random\n"),
        (("--ray", "--optuna", "2"), "--optuna runs on this machine only"),
        (("--metric", "success_rate"), "--metric goes with --optuna"),
        (("--optuna", "2", "--metric", "foo", "--set", "training.iterations=2,3"), "--metric 'foo'"),
        (("--name", "x" * 63), "too long"),
        (("--name", "a/b"), "--name"),
    ):
        found = skill("--store", tmp_path / "store", "sweep", "smoke", *words)
        assert found.code == 2 and told in found.err, found.err
    assert not (tmp_path / "store").exists()


def test_a_plan_lists_its_cells_by_setting_and_seed() -> None:
    same = ("evaluation.latents", "3")
    plan = SweepPlan("smoke", ((same, ("training.iterations", "2")), (same, ("training.iterations", "4"))), (3, 5), "grid")
    cells = list(plan.cells())
    assert [(cell.index, cell.setting, cell.seed) for cell in cells] == [(0, 0, 3), (1, 0, 5), (2, 1, 3), (3, 1, 5)]
    assert [plan.place(cell.index) for cell in cells] == [(cell.setting, cell.seed) for cell in cells]
    assert cells[2].recipe["training"]["iterations"] == 4 and cells[2].name == "grid.iterations-4.s3"
    assert cells[2].command == (
        "skill pretrain smoke --seed 3 --set evaluation.latents=3 --set training.iterations=4 --name grid.iterations-4.s3"
    )
    with pytest.raises(UsageError, match="at most"):
        SweepPlan("smoke", ((),), tuple(range(30_000)), "grid")


def test_hashes_are_kept_as_numbers() -> None:
    sha = "00ff" + "0123456789abcdef" * 3 + "fedcba987654"
    assert len(sha) == 64 and sha_text(np.array(sha_words(sha))) == sha and sha_words("") == [0] * 8


def _check_that_shared_runs_are_said(root: Path) -> None:
    asked = ("--seeds", "0-1", *TINY_SET[2:], "--set", "training.iterations=2", "--name", "half")
    assert made("--store", root, "sweep", "smoke", *asked)["reused"] == 2
    both = ("compare", "grid/sweep", "half/sweep", "--metric", "success_rate")
    found = made("--store", root, *both)
    labels = [group["label"] for group in found["metrics"][0]["groups"]]
    assert found["shared_runs"] == 2
    assert labels == [
        f"{sweep}-v1: training.iterations={n}" for sweep, n in (("grid/sweep", 2), ("grid/sweep", 3), ("half/sweep", 2))
    ]
    told = " ".join(skill("--store", root, *both).out.split())
    assert "the groups share runs (2), so they are not independent" in told
    Store(root).path(ArtifactId("half", "sweep", 1)).unlink()


def _check_what_can_be_drawn(root: Path, tmp_path: Path) -> None:
    drawn = made("--store", root, "viz", "grid/sweep", "--png", tmp_path / "drawn.svg")
    assert (drawn["rrd"], drawn["entities"]) == (None, []) and (tmp_path / "drawn.svg").stat().st_size > 1000
    refused = skill("--store", root, "viz", "grid/sweep", "--web", "-o", tmp_path / "x.rrd")
    assert refused.code == 1 and "leave out -o and --web" in refused.err and not (tmp_path / "x.rrd").exists()
    assert made("--store", root, "viz", "-o", tmp_path / "newest.rrd")["id"].endswith("/pretrain-v1")


def test_a_sweep_is_compared_and_reported(tmp_path: Path) -> None:
    root, page, figure = tmp_path / "store", tmp_path / "page.html", tmp_path / "figure.png"
    asked = ("--seeds", "0-1", *TINY_SET[2:], "--set", "training.iterations=2,3", "--name", "grid")
    made("--store", root, "sweep", "smoke", *asked)
    found = made("--store", root, "compare", "grid/sweep", "--metric", "success_rate", "--png", figure)
    (metric,) = found["metrics"]
    assert [(group["label"], group["n"]) for group in metric["groups"]] == [
        ("training.iterations=2", 2), ("training.iterations=3", 2),
    ]  # fmt: skip
    assert all(len(group["ci95"]) == 2 for group in metric["groups"])
    (pair,) = metric["probability_of_improvement"]
    assert pair["verdict"] == "too few runs to tell" and pair["pairs"] == 2 and pair["needed"] == 6
    assert [curve["n"][-1] for curve in found["sample_efficiency"]] == [2, 2] and figure.stat().st_size > 1000
    assert found["shared_runs"] == 0
    _check_that_shared_runs_are_said(root)
    _check_what_can_be_drawn(root, tmp_path)
    by_hand = made("--store", root, "compare", *(f"grid.iterations-{n}.s{s}/pretrain" for n in (2, 3) for s in (0, 1)))
    same = by_hand["metrics"][0]["groups"]
    assert [group["iqm"] for group in same] == [group["iqm"] for group in metric["groups"]]
    assert [group["label"] for group in same] == ["training.iterations=2", "training.iterations=3"]
    reported = made("--store", root, "report", "-o", page)
    assert reported["artifacts"] == ["grid/sweep-v1"] and [one["title"] for one in reported["figures"]] == [
        "Settings of grid compared"
    ]
    assert "Many runs" in page.read_text(encoding="utf-8") and "too few runs to tell" in page.read_text(encoding="utf-8")
    for words in (("grid/sweep", "grid.iterations-2.s0/pretrain"), ("grid/sweep", "--metric", "speed"), ("grid/sweep",) * 2):
        assert skill("--store", root, "compare", *words).code == 2
