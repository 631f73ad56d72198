"""README, CONTRIBUTING and docs/ hold what they promise: links lead somewhere, commands parse, names exist, examples work."""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from composition.plane import ORIGIN, Plane

from skillcli.cli.app import app
from skillcli.composition.plan import Choices, schedule
from skillcli.composition.planner import run
from skillcli.composition.route import Route
from skillcli.recipe import Recipe, load_recipe, resolve
from skillcli.tasks.registry import ROOMS as DESCRIPTIONS

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")))
}

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@pytest.fixture(params=PAGES)
def page(request: pytest.FixtureRequest) -> Path:
    return PAGES[request.param]


def blocks(page: Path) -> list[str]:
    """Indented code, without the indent."""
    found = re.findall(r"(?:(?<=\n\n)|^)((?:    .*\n|\n)+)", page.read_text(encoding="utf-8") + "\n")
    return [re.sub(r"^ {4}", "", block, flags=re.MULTILINE).strip("\n") + "\n" for block in found]


def prose(page: Path) -> str:
    return re.sub(r"^    .*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)


def spans(page: Path) -> list[str]:
    """Code within the text."""
    return re.findall(r"`([^`\n]+)`", prose(page))


def anchors(page: Path) -> set[str]:
    """What its headings are called in a link."""
    headings = re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()) for heading in headings}


def test_every_relative_link_and_picture_is_there(page: Path) -> None:
    wrong = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        found = page.parent / name if name else page
        if not found.exists() or (anchor and anchor not in anchors(found)):
            wrong.append(target)
    assert not wrong


def test_every_page_is_in_the_menu_of_the_site() -> None:
    listed = re.findall(r"([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(listed) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def command_at(words: list[str]) -> tuple[Any, list[str], dict[str, Any]]:
    """The command that words name, the words behind it, and the options of the app that stood before it."""
    command: Any = typer.main.get_command(app)
    before: dict[str, Any] = {}
    words = list(words)
    while words and words[0].startswith("--"):
        option = words.pop(0)
        known = {name: param for param in command.params for name in param.opts}
        assert option in known, option
        before[option] = None if getattr(known[option], "is_flag", False) else words.pop(0)
    while words and words[0] in getattr(command, "commands", {}):
        command = command.commands[words.pop(0)]
    return command, words, before


def test_every_command_in_a_block_parses(page: Path) -> None:
    for line in re.findall(r"^\$ skill (.+)$", "".join(blocks(page)), flags=re.MULTILINE):
        command, words, before = command_at(shlex.split(line, comments=True))
        assert before or command is not typer.main.get_command(app), line
        assert command.name != "skill" or not words, f"no such command: {line}"
        command.make_context(command.name, words)


def test_every_command_in_the_text_exists_with_its_options(page: Path) -> None:
    for span in spans(page):
        if not span.startswith("skill "):
            continue
        for alternative in span.removeprefix("skill ").split(" · "):
            words = re.sub(r"[\[\]…]", " ", alternative).split()
            if words == ["COMMAND", "--help"]:
                continue
            command, rest, _ = command_at(words)
            options = {name for param in command.params for name in (*param.opts, *param.secondary_opts)} | {"--help"}
            used = {word.partition("=")[0] for word in rest if re.match(r"-{1,2}[a-z]", word)}
            stray = hasattr(command, "commands") and rest and rest[0].islower() and not rest[0].startswith("-")
            assert not stray, f"no such command: {span}"
            if "--method" in rest:
                continue  # options that belong to one method are parsed where they stand in a block
            assert used <= options, f"{span}: {sorted(used - options)}"


def names_in(path: Path) -> set[str]:
    """What a module defines at its top."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def test_every_module_and_name_of_the_code_is_there(page: Path) -> None:
    new = ("planar.py", "skillcli/composition/greedy.py", "numpy_policy.py")  # the examples of pages
    for span in spans(page):
        found = re.fullmatch(r"((?:[\w-]+/)*\w+\.py)(?:: (\w+))?", span)
        if not found or span in new:
            continue
        path = next((base / found[1] for base in (ROOT, ROOT / "skillcli") if (base / found[1]).is_file()), None)
        assert path is not None, f"no module {span}"
        assert found[2] is None or found[2] in names_in(path), f"no {found[2]} in {found[1]}"


def test_every_recipe_key_that_is_named_exists(page: Path) -> None:
    known = {
        f"{section}.{key}"
        for name in DESCRIPTIONS
        for section, part in resolve({"name": "any", "task": {"name": name}})
        for key in getattr(type(part), "model_fields", {})
    }
    for span in spans(page):
        section, _, key = span.removeprefix("--set ").partition("=")[0].partition(".")
        if section in Recipe.model_fields and section != "robot" and re.fullmatch(r"[a-z_]+", key) and section != "greedy":
            assert f"{section}.{key}" in known or key == "py", span


def block_with(name: str, text: str) -> str:
    return next(block for block in blocks(DOCS / name) if text in block)


def test_the_tutorials_recipe_loads(tmp_path: Path) -> None:
    path = tmp_path / "shelf.toml"
    path.write_text(block_with("tutorial.md", 'name = "shelf"'), encoding="utf-8")
    recipe = load_recipe(str(path))
    assert recipe.task.names == ("left", "right", "top", "near") and len(recipe.task.goals) == 4
    assert recipe.compose.task == "" and len(recipe.compose.goals) == 2


def test_an_artifact_is_read_as_shown(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    exec(block_with("artifacts.md", "import h5py"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("(1, 50, 3)") and "episode,step+1,xyz" in first and second == "True 2.45"


@pytest.fixture
def with_greedy(tmp_path: Path) -> Path:
    """A copy of the code with what docs/add-a-planner.md adds: its file, and its line in the table of methods."""
    text = (DOCS / "add-a-planner.md").read_text(encoding="utf-8")
    (line,) = re.findall(r'^    "greedy": Method\(.*\),$', text, flags=re.MULTILINE)
    copy = shutil.copytree(ROOT / "skillcli", tmp_path / "skillcli", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "recipes").symlink_to(ROOT / "recipes")
    (copy / "composition" / "greedy.py").write_text(block_with("add-a-planner.md", "class GreedyPlanner"), encoding="utf-8")
    table = copy / "composition" / "registry.py"
    before = table.read_text(encoding="utf-8")
    table.write_text(before.replace("METHODS = {\n", f"METHODS = {{\n{line}\n"), encoding="utf-8")
    return tmp_path


def with_code(folder: Path, code: str, *words: str | Path) -> str:
    """What a program prints that runs with the code in a folder."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
    command = [sys.executable, "-c", code, *map(str, words)]
    told = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, timeout=120)
    assert told.returncode == 0, told.stderr
    return told.stdout


COMMAND_LINE = "from skillcli.cli.main import main; main()"
FROM_PYTHON = """
import sys
from pathlib import Path
from skillcli.evaluation.consistency import stored_recipe
from skillcli.stages.compose import Request, compose
from skillcli.store import ArtifactId, Store

store = Store(Path(sys.argv[1]))
source = store.read(ArtifactId("tiny", "embed-means", 1))
recipe = stored_recipe(source, ["greedy.seconds=1.0"])
artifact = compose(store, source.id, recipe, Request.of(recipe, "", [(0.6, 0.1, 0.25)], "greedy"), "greedy", "test")
print(artifact.results["method"], 1 <= len(artifact.results["segments"]) <= 4, artifact.recipe["greedy"]["seconds"])
"""


def test_the_planner_that_is_shown_composes_from_python_and_from_the_command_line(
    with_greedy: Path, chain: Path, tmp_path: Path
) -> None:
    store = shutil.copytree(chain, tmp_path / "artifacts")
    assert with_code(with_greedy, FROM_PYTHON, store).split() == ["greedy", "True", "1.0"]
    words = ("--json", "--store", store, "compose", "tiny/embed-means", "--method", "greedy", "--goal", "0.6,0.1,0.25")
    found = json.loads(with_code(with_greedy, COMMAND_LINE, *words, "--ensemble", "2", "--set", "greedy.segment=0.5"))
    assert found["method"] == "greedy" and found["robots"] == 2 and found["segments"][0]["seconds"] == 0.5
    assert "greedy: hold whichever latent leads nearest" in with_code(with_greedy, COMMAND_LINE, "compose", "--help")
    shown = with_code(with_greedy, COMMAND_LINE, "compose", "--method", "greedy", "--help")
    assert "--ensemble" in shown and "--on" in shown and "--heuristic" not in shown


def test_the_planner_that_is_shown_works() -> None:
    space: dict[str, Any] = {}
    exec(block_with("add-a-planner.md", "class GreedyPlanner"), space)
    choices = Choices.of(np.array([[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0]]), ("east", "north", "west"), False)
    route = Route(np.array([[0.4, 0.0, 0.0], [0.4, 0.2, 0.0]]), tolerance=0.01)
    planner = space["GreedyPlanner"](ORIGIN, route, choices, 0.01, 2, 10)
    run(planner, Plane(), lambda *_: None)
    assert [segment.label for segment in planner.plan()] == ["east", "east", "north"]
    assert schedule(planner.plan())[0].sum(axis=0) == pytest.approx([0.4, 0.2])
    assert planner.finished and len(planner.plan()) < 10
