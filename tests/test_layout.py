"""Tests mirror the package: every folder of tests has the name of one of skillcli. The docs show each part on its floor."""

import importlib
import re
from pathlib import Path

import pytest
from test_imports import FLOORS

import skillcli
from skillcli.kinds import KINDS

TESTS, PACKAGE = Path(__file__).parent, Path(skillcli.__file__).parent
OF_THEIR_OWN = {"store/golden", "store/hostile"}  # files of every schema there has been, and files made to do harm


def folders(root: Path) -> set[str]:
    """Every folder with a file in it, or below it, that is no left-over of a run."""
    files = (path.relative_to(root) for path in root.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {folder.as_posix() for path in files for folder in path.parents} - {"."}


def test_every_folder_of_tests_has_its_counterpart() -> None:
    strange = folders(TESTS) - folders(PACKAGE)
    assert {one for one in strange if not one.startswith(tuple(OF_THEIR_OWN))} == set()


def test_the_exceptions_are_still_there() -> None:
    assert folders(TESTS) >= OF_THEIR_OWN and not folders(PACKAGE) & OF_THEIR_OWN


def test_no_two_files_of_tests_have_one_name() -> None:
    names = [path.name for path in TESTS.rglob("test_*.py")]  # pytest tells them apart by name, without their folders
    assert sorted(names) == sorted(set(names))


def test_the_docs_show_every_part_on_its_floor() -> None:
    page = (TESTS.parent / "docs" / "index.md").read_text(encoding="utf-8")
    shown = dict.fromkeys(range(len(FLOORS) + 1), frozenset[str]())
    for floor, parts in re.findall(r"^    (\d+) +([a-z]+(?:, [a-z]+)*)", page, flags=re.MULTILINE):
        shown[int(floor)] |= set(parts.split(", "))
    above = set[str]().union(*FLOORS)
    ground = {path.stem for path in PACKAGE.glob("[a-z]*.py")} - above
    assert shown == dict(enumerate([ground, *FLOORS]))


def test_every_stage_is_called_as_the_kind_that_it_writes() -> None:
    stages = {path.stem.replace("_", "-") for path in (PACKAGE / "stages").glob("[a-z]*.py")}
    assert stages == {*KINDS, "chain"}, "chain calls them one after the other"


@pytest.mark.parametrize("study", sorted(path.stem for path in (TESTS.parent / "studies").glob("[!_]*.py")))
def test_every_study_fits_the_code_of_today(study: str) -> None:
    assert callable(importlib.import_module(f"studies.{study}").main)
