"""Living with a store: finding, comparing, keeping, sending and migrating artifacts from the command line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import CHAIN, files, made, skill
from forge import forge

from skillcli.cli import terminal_plots
from skillcli.cli.terminal import Terminal
from skillcli.store import ArtifactId, Store

GOLDEN = Path(__file__).parent.parent / "store" / "golden"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with tiny/pretrain-v1 … tiny/transfer-eval-v1 and two artifacts of an older schema."""
    not_of_the_chain = shutil.ignore_patterns("execution-*", "play-*", "sweep-*")
    return shutil.copytree(GOLDEN, tmp_path / "artifacts", ignore=not_of_the_chain)


def listed(store: Path, *words: str) -> list[str]:
    return [one["id"] for one in made("--store", store, "ls", *words)["artifacts"]]


def said(store: Path, *words: str | Path) -> str:
    result = skill("--store", store, *words)
    assert result.code == 0, result.err
    return result.out


def test_ls_filters_by_kind_name_recipe_and_date(store: Path) -> None:
    everything = listed(store)
    assert len(everything) == 6
    assert listed(store, "--kind", "compose") == ["reference-point/compose-v1", "tiny/compose-v1"]
    assert listed(store, "--name", "tiny", "--recipe", "smo*") == [f"tiny/{stage}-v1" for stage in CHAIN]
    assert listed(store, "--recipe", "point") == ["reference-point/embed-means-v1", "reference-point/compose-v1"]
    dates = {one["id"]: one["created_utc"] for one in made("--store", store, "ls")["artifacts"]}
    second = dates[everything[1]]
    assert listed(store, "--since", second) == everything[1:] and listed(store, "--before", second) == everything[:1]
    assert listed(store, "--since", "2999-01-01") == [] and listed(store, "--before", "2999-01-01T12:00+02:00") == everything
    for words in (["--kind", "video"], ["--since", "yesterday"]):
        assert skill("--store", store, "--json", "ls", *words).code == 2
    assert "schema 1: migrate" in said(store, "ls")


def test_a_sweep_with_its_cells_is_one_row_unless_they_are_asked_for(store: Path) -> None:
    shutil.copy(GOLDEN / "tiny" / "sweep-v1.h5", store / "tiny")
    trained = Store(store).read(ArtifactId("tiny", "pretrain", 1))
    for name in ("tiny.iterations-2.s0", "tiny.s1", "tinyer.s0"):
        forge(Store(store), trained, id=ArtifactId(name, "pretrain", 1))
    for words, shown in (((), False), (("--cells",), True), (("--name", "tiny*"), True), (("--kind", "pretrain"), True)):
        rows = said(store, "ls", *words)
        assert ("tiny.iterations-2.s0" in rows) is shown and "tinyer.s0" in rows
    assert "2 artifacts of its cells" in said(store, "ls")
    member = {one["id"]: one["sweep"] for one in made("--store", store, "ls")["artifacts"]}
    assert member["tiny.s1/pretrain-v1"] == "tiny" and member["tinyer.s0/pretrain-v1"] is None


def test_a_long_listing_has_the_same_columns_without_a_frame(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skillcli.cli.store_view.LONG", 2)
    lines = said(store, "ls").splitlines()
    assert len(lines) == 7 and lines[0].split() == ["id", "made", "(UTC)", "recipe", "seed", "kB", "note"]
    assert any(line.startswith("tiny/transfer-eval-v1 ") for line in lines)


def test_show_draws_recipe_curves_and_lineage(store: Path) -> None:
    shown = said(store, "show", "tiny/pretrain")
    assert "policy_hidden" in shown and "return" in shown and any(bar in shown for bar in "▁▂▃▄▅▆▇█")
    tree = said(store, "show", "tiny/transfer-eval")
    assert all(f"tiny/{stage}-v1" in tree for stage in CHAIN)
    facts = made("--store", store, "show", "tiny/compose")
    assert facts["lineage"] == ["tiny/embed-means-v1", "tiny/pretrain-v1"] and facts["schema_version"] == 2
    assert facts["dependents"] == ["tiny/transfer-eval-v1"] and facts["pinned"] is False


def test_a_sparkline_shows_the_course_of_a_curve() -> None:
    assert terminal_plots.sparkline(np.arange(8)) == "▁▂▃▄▅▆▇█"
    assert terminal_plots.sparkline([3, 3, 3]) == "▁▁▁"
    assert terminal_plots.sparkline([0, np.nan, 7]) == "▁ █"
    assert terminal_plots.sparkline([np.nan]) == " "
    assert len(terminal_plots.sparkline(np.arange(1000))) == terminal_plots.WIDTH


@pytest.mark.slow
def test_verify_one_a_lineage_or_everything(store: Path) -> None:
    assert made("--store", store, "verify", "tiny/compose") == {"id": "tiny/compose-v1", "ok": True, "problems": []}
    found = made("--store", store, "verify", "tiny/transfer-eval", "--lineage")
    assert [one["id"] for one in found["artifacts"]] == [f"tiny/{stage}-v1" for stage in reversed(CHAIN)]
    path = store / "tiny" / "pretrain-v1.h5"
    data = bytearray(path.read_bytes())
    data[9000] ^= 1
    path.write_bytes(data)
    assert made("--store", store, "verify", "tiny/transfer-eval")["ok"] is True
    for words in (["tiny/transfer-eval", "--lineage"], ["--all"]):
        result = skill("--store", store, "--json", "verify", *words)
        assert result.code == 1 and not result.json["ok"] and "error" in result.json
        bad = [one["id"] for one in result.json["artifacts"] if not one["ok"]]
        assert "tiny/pretrain-v1" in bad and "tiny/transfer-eval-v1" not in bad
    assert skill("--store", store, "--json", "verify", "tiny/compose", "--all").code == 2


def test_diff_tells_what_differs_and_nothing_else(store: Path) -> None:
    made("--store", store, "migrate", "reference-point/compose")
    found = made("--store", store, "diff", "tiny/compose", "reference-point/compose")
    assert found["same_content"] is False
    assert found["recipe"]["name"] == ["smoke", "point"] and found["results"]["robots"] == [1, None]
    assert found["arrays"]["plan/latent"] == ["float64 (1, 3)", "float64 (6, 2)"]
    same = made("--store", store, "diff", "tiny/compose", "tiny/compose-v1")
    assert same["same_content"] and not any(same[part] for part in ("origin", "recipe", "packages", "results", "arrays"))
    assert "differ in content" in said(store, "diff", "tiny/compose", "reference-point/compose")


def test_migration_is_offered_and_done(store: Path) -> None:
    refused = skill("--store", store, "--json", "show", "reference-point/compose")
    assert refused.code == 1 and f"--store {store} migrate reference-point/compose-v1`" in refused.json["error"]["hint"]
    new = made("--store", store, "migrate", "reference-point/compose-v1")
    assert new == {"id": "reference-point/compose-v2", "migrated_from": "reference-point/compose-v1", "schema_version": 2}
    assert "migrated from" in said(store, "show", "reference-point/compose")
    assert skill("--store", store, "--json", "migrate", "reference-point/compose").code == 1


def test_gc_shows_first_and_keeps_pins(store: Path) -> None:
    made("--store", store, "migrate", "reference-point/compose")
    (store / "tiny" / ".tmp-x-00000000-1-ff.h5").write_bytes(b"123")
    os.utime(store / "tiny" / ".tmp-x-00000000-1-ff.h5", (0, 0))
    os.utime(store / "reference-point" / "compose-v1.h5")
    assert made("--store", store, "gc")["young"] == ["reference-point/compose-v1"]
    assert "made within the last hour: 1" in said(store, "gc")
    os.utime(store / "reference-point" / "compose-v1.h5", (0, 0))
    before = files(store)
    shown = made("--store", store, "gc")
    assert [one["id"] for one in shown["artifacts"]] == ["reference-point/compose-v1"] and len(shown["leftovers"]) == 1
    assert shown["applied"] is False and files(store) == before
    assert "would remove 2 files" in said(store, "gc")

    assert made("--store", store, "pin", "reference-point/compose-v1")["pinned"] is True
    assert made("--store", store, "gc")["artifacts"] == []
    assert "pinned" in said(store, "ls")
    assert skill("--store", store, "--json", "rm", "reference-point/compose-v1").code == 1
    made("--store", store, "unpin", "reference-point/compose-v1")

    assert made("--store", store, "gc", "--apply")["bytes"] == shown["bytes"]
    assert len(before - files(store)) == 2 and "nothing to remove" in said(store, "gc", "--apply")


@pytest.mark.slow
def test_export_and_import_move_a_chain(store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sent = made("--store", store, "export", "tiny/transfer-eval")
    assert sent["file"] == "tiny-transfer-eval-v1.tar" and sent["artifacts"] == [f"tiny/{stage}-v1" for stage in CHAIN]
    got = made("--store", tmp_path / "other", "import", sent["file"])
    assert got["id"] == "tiny/transfer-eval-v1" and all(one["new"] for one in got["artifacts"])
    assert made("--store", tmp_path / "other", "verify", "--all")["ok"]
    assert "already here" in said(tmp_path / "other", "import", sent["file"])
    Path("bad.tar").write_bytes(b"\0" * 2000)
    refused = skill("--store", tmp_path / "other", "--json", "import", "bad.tar")
    assert refused.code == 1 and "bad.tar" in refused.json["error"]["message"]


def test_a_lock_that_was_left_behind_is_explained_and_removed(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skillcli.store.lock.PATIENCE_SECONDS", 0.01)
    (store / ".lock").symlink_to("skill:aaaaaa:bbbbbb:cccc:dddddddd:7:1:far")
    refused = skill("--store", store, "--json", "rm", "tiny/transfer-eval-v1")
    assert refused.code == 1 and "process 7 on far" in refused.json["error"]["message"]
    assert f"`skill --store {store} unlock`" in refused.json["error"]["hint"]
    assert made("--store", store, "unlock")["owner"].startswith("process 7 on far")
    assert made("--store", store, "unlock") == {"unlocked": False, "owner": None}
    made("--store", store, "rm", "tiny/transfer-eval-v1")


def complete(store: Path, *words: str) -> tuple[list[str], set[str]]:
    """What bash would offer behind these words, and which slow packages were loaded for it."""
    line = " ".join(["skill", "--store", str(store), *words])
    code = (
        "import sys; sys.argv = ['skill']\n"
        "from skillcli.cli.app import app\n"
        "try: app(prog_name='skill')\n"
        "except SystemExit: pass\n"
        "print({'numpy', 'h5py', 'torch'} & set(sys.modules), file=sys.stderr)"
    )
    settings = {"_SKILL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) + 2)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **settings}, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), eval(done.stderr.splitlines()[-1].replace("set()", "frozenset()"))


@pytest.mark.slow
def test_the_shell_completes_ids_without_loading_anything_slow(store: Path) -> None:
    offered, slow = complete(store, "show", "ti")
    assert sorted(offered) == sorted(f"tiny/{stage}-v1" for stage in CHAIN) and not slow
    assert complete(store, "viz", "reference-point/c")[0] == ["reference-point/compose-v1"]
    assert complete(store, "rm", '""')[0] in (["reference-point/", "tiny/"], [])


def test_square_brackets_in_a_recipe_are_text() -> None:
    console = Terminal(width=60, record=True)
    console.print(terminal_plots.recipe({"description": "goals [/x] and [bold]"}))
    assert "goals [/x] and [bold]" in console.export_text()


def test_a_recording_is_not_written_under_the_name_of_a_picture(store: Path, tmp_path: Path) -> None:
    result = skill("--store", store, "--json", "viz", "tiny/compose", "-o", tmp_path / "a.png")
    assert result.code == 2 and "--png" in result.json["error"]["hint"] and not (tmp_path / "a.png").exists()
