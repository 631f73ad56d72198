"""Text from files is text wherever it is shown: never markup, never a formula, never an escape of the terminal."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from command import CHAIN, Result, skill
from rich.table import Table
from rich.text import Text

from skillcli.cli.terminal import Terminal
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.viz import figure_style

EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m[/] [bold]:skull: $\\frac{$ `a` *b* | <b>\u202e\udc9b\r\b\x00 x"
ACTING = {*map(chr, range(32)), *map(chr, range(127, 160)), "\u202e", "\udc9b"} - {"\n", "\t"}


def evil(value: Any, name: str = "") -> Any:
    """The same results with every name and remark in them replaced, but for those that say what is drawn."""
    if isinstance(value, Mapping):
        return {key: evil(item, key) for key, item in value.items()}
    if isinstance(value, list):
        return [evil(item, name) for item in value]
    return f"{value}{EVIL}" if isinstance(value, str) and name not in ("method", "fingerprint", "name", "domain") else value


@pytest.fixture(scope="module")
def hostile(chain: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with evil/… of every kind, written through the front door by a machine with evil packages."""
    folder = tmp_path_factory.mktemp("hostile") / "artifacts"
    shutil.copytree(chain, folder)
    store = Store(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skillcli.store.codec.package_versions", lambda: {EVIL: EVIL})
        for stage in CHAIN:
            good = store.read(ArtifactId("tiny", stage, 1))
            parents = [ArtifactId("evil", parent.id.stage, 1) for parent in good.parents]
            store.write(_draft(good, parents))
    return folder


def _draft(good: Artifact, parents: list[ArtifactId]) -> Draft:
    recipe = {**good.recipe, "description": EVIL}
    kept = {"seed": good.seed, "arrays": good.arrays, "measured": {**good.measured, EVIL: EVIL}}
    results = evil(good.results)
    return Draft(kind=good.kind, name="evil", command=EVIL, recipe=recipe, results=results, parents=parents, **kept)


def check(result: Result, *codes: int) -> Result:
    assert result.code in (codes or (0,)), result
    assert "unexpected" not in result.err and "Traceback" not in result.err, result.err
    assert not ACTING & {*result.out, *result.err}, result
    return result


def test_names_and_remarks_act_nowhere(hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figure_style, "DPI", 40)
    monkeypatch.chdir(tmp_path)
    for words in (["ls"], ["gc"], ["verify", "--all"], ["diff", "evil/pretrain", "tiny/pretrain"], ["export", "evil"]):
        check(skill("--store", hostile, *words), 0, 1)
        check(skill("--store", hostile, "--json", *words), 0, 1)
    for stage in CHAIN:
        shown = check(skill("--store", hostile, "show", f"evil/{stage}-v1"))
        assert r"\x1b[2J" in shown.out and ":skull:" in shown.out and "[/] [bold]" in shown.out.replace("\n", " ")
        assert json.loads(check(skill("--store", hostile, "--json", "show", f"evil/{stage}-v1")).out)["command"] == EVIL


@pytest.mark.parametrize("stage", ["compose", "transfer-eval"])
def test_pictures_and_recordings_take_any_name(
    hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    monkeypatch.setattr(figure_style, "DPI", 40)
    check(skill("--store", hostile, "viz", f"evil/{stage}-v1", "-o", tmp_path / "a.rrd", "--png", tmp_path / "a.png"))


def test_a_page_takes_any_name(hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figure_style, "DPI", 40)
    check(skill("--store", hostile, "report", "evil/transfer-eval-v1", "-o", tmp_path / "a.html"))
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert r"\x1b[2J" in page and not ACTING & {*page} and "<b>\\u202e" not in page


def test_a_lock_of_anybody_is_told_as_text(hostile: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skillcli.store.lock.PATIENCE_SECONDS", 0.01)
    (hostile / ".lock").write_text(EVIL, errors="surrogatepass")
    assert "locked by an unknown process" in check(skill("--store", hostile, "rm", "evil/transfer-eval-v1"), 1).err
    check(skill("--store", hostile, "unlock"))
    assert not (hostile / ".lock").exists()


@pytest.mark.parametrize(
    "words", [["show", EVIL.replace("\0", "")], ["ls", "--kind", EVIL], ["compose", "--goal", EVIL], ["pretrain", EVIL], [EVIL]]
)
def test_what_was_typed_is_said_again_as_text(hostile: Path, words: list[str]) -> None:
    check(skill("--store", hostile, *words), 1, 2)


def test_a_store_may_have_any_path(tmp_path: Path) -> None:
    check(skill("--store", tmp_path / "[bold]x\x1b[2J[/]", "ls"), 1)


def test_every_way_to_print_makes_text_safe() -> None:
    terminal = Terminal(width=60, record=True, force_terminal=True, color_system="truecolor")
    table = Table(EVIL)
    table.add_row(Text(EVIL, "red"))
    with terminal.capture() as printed:
        terminal.print(EVIL, Text(EVIL), table)
    plain = printed.get()
    assert "\x1b]0" not in plain and "\x1b[2J" not in plain and "\x9b" not in plain and "[/] [bold]" in plain
    assert "\x1b[" in plain, "our own colours stay"
