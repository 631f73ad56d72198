"""What is installed: one version everywhere, and every file that the code reads."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from command import skill

import skillcli
from skillcli.recipe import recipe_names
from skillcli.store.provenance import package_versions

ROOT = Path(skillcli.__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_version_has_one_home() -> None:
    assert "version" not in SETTINGS["project"] and SETTINGS["project"]["dynamic"] == ["version"]
    assert SETTINGS["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "skillcli.__version__"}
    assert re.fullmatch(r"\d+\.\d+\.\d+", skillcli.__version__)


def test_the_version_is_told_and_stored() -> None:
    assert skill("--version").out == f"skill {skillcli.__version__}\n"
    assert package_versions()["skillcli"] == skillcli.__version__


def test_changelog_and_citation_are_of_this_version() -> None:
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert newest is not None and newest[1] == skillcli.__version__
    assert cited is not None and cited[1] == skillcli.__version__


def test_every_file_that_is_no_code_is_package_data() -> None:
    data = SETTINGS["tool"]["setuptools"]["package-data"]
    left_out = []
    for path in Path(skillcli.__file__).parent.rglob("*"):
        if path.is_dir() or path.suffix in (".py", ".pyc"):
            continue
        package = ".".join(path.parent.relative_to(ROOT).parts)
        if not any(path.match(pattern) for pattern in data.get(package, ())):
            left_out.append(path.relative_to(ROOT).as_posix())
    assert not left_out


def test_recipes_are_package_data_from_beside_the_package() -> None:
    tool = SETTINGS["tool"]["setuptools"]
    assert tool["package-dir"] == {"skillcli.recipes": "recipes"} and tool["package-data"]["skillcli.recipes"] == ["*.toml"]
    assert recipe_names() == sorted(path.stem for path in (ROOT / "recipes").iterdir())


def test_types_are_offered_to_those_who_import_it() -> None:
    assert (Path(skillcli.__file__).parent / "py.typed").read_bytes() == b""
