"""The examples of docs/python.md and docs/gymnasium.md, and the notebook, do what they say."""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path
from typing import Any

import pytest

import skillcli

ROOT = Path(skillcli.__file__).parents[1]

pytestmark = pytest.mark.slow


def examples(page: str) -> list[str]:
    """The blocks of Python on a page, in order; blocks of commands begin with `$`."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"(?<=\n\n)((?:    .*\n(?:\n(?=    ))?)+)", text)
    code = [textwrap.dedent(block) for block in blocks]
    return [block for block in code if not block.startswith("$")]


@pytest.mark.parametrize(("page", "count"), [("python.md", 8), ("gymnasium.md", 5)])
def test_examples_run(page: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("stable_baselines3" if page == "gymnasium.md" else "xarray")
    monkeypatch.chdir(ROOT)
    found = examples(page)
    assert len(found) == count
    space: dict[str, Any] = {}
    for block in found:
        exec(block, space)


def test_the_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xarray")
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((ROOT / "docs" / "tour.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) == 6 and notebook["nbformat"] == 4
    assert all(not cell.get("outputs") for cell in notebook["cells"])
    space: dict[str, Any] = {}
    for cell in cells:
        exec(cell, space)
