"""Write the report: the artifacts of a store beside the paper's results, as one page and its figures."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillcli import __version__
from skillcli.errors import SkillError
from skillcli.files import replacing
from skillcli.plaintext import visible
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.viz.report.comparison import tables
from skillcli.viz.report.content import Missing, Origin, Page, RecipeText
from skillcli.viz.report.figures import SLUGS, make_figures
from skillcli.viz.report.page import render
from skillcli.viz.report.runs import RUN_SLUGS, compare_sweeps
from skillcli.viz.report.selection import Material, select

SUFFIXES = ("pdf", "png")  # of the figures beside the page


@dataclass(frozen=True)
class Reported:
    """The written files."""

    html: Path
    folder: Path
    page: Page


def report(store: Store, ids: Sequence[ArtifactId], path: Path) -> Reported:
    """Write a page about artifacts and their ancestors, and its figures into a folder beside it.

    Args:
        store: to read from.
        ids: which artifacts; with none, the newest of every kind and name.
        path: the page; figures go to NAME_figures beside it.

    Raises:
        SkillError: there is nothing to report, or the files cannot be written. Nothing is left half-written.
    """
    _check_place(path)
    material = select(store, ids)
    figures, missing = make_figures(material)
    comparisons, untold = compare_sweeps(store, material.sweeps)
    page = Page(
        figures=figures,
        comparisons=comparisons,
        tables=tables(material),
        origins=[*(_origin(exhibit.artifact) for exhibit in material.exhibits), *map(_origin, material.sweeps)],
        recipes=_recipes(material),
        not_drawn=[*missing, *untold],
        skipped=[Missing(str(one), reason) for one, reason in material.skipped],
        left_out=material.left_out,
        version=__version__,
    )
    folder = path.with_name(f"{path.stem}_figures")
    drawn = [*figures, *(comparison.figure for comparison in comparisons)]
    files = {folder / f"{figure.slug}.{suffix}": figure.files[suffix] for figure in drawn for suffix in SUFFIXES}
    _write(folder, {**files, path: visible(render(page)).encode()})
    return Reported(path, folder, page)


def _check_place(path: Path) -> None:
    """Refuse before the work a path that cannot be written."""
    if path.is_dir():
        raise SkillError(f"cannot write {path}: it is a folder", "give the name of a file, such as report.html")
    if not path.parent.is_dir():
        raise SkillError(f"cannot write {path}: there is no folder {path.parent}", "make it, or choose another")


def _write(folder: Path, files: Mapping[Path, bytes]) -> None:
    """Write page and figures, all or none, and remove figures of an earlier report that this one lacks."""
    new = not folder.exists()
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise SkillError(f"cannot make the folder {folder}: {error.strerror}", "choose another place for the page") from error
    try:
        with replacing(*files) as temporary:
            for unfinished, data in zip(temporary, files.values(), strict=True):
                unfinished.write_bytes(data)
    except BaseException:
        if new:
            folder.rmdir()
        raise
    for old in {folder / f"{slug}.{suffix}" for slug in SLUGS | RUN_SLUGS for suffix in SUFFIXES} - files.keys():
        old.unlink(missing_ok=True)


def _origin(artifact: Artifact) -> Origin:
    return Origin(
        id=str(artifact.id),
        kind=artifact.kind,
        content_sha256=artifact.content_sha256,
        recipe_name=artifact.recipe_name,
        recipe_sha256=artifact.recipe_sha256,
        seed=artifact.seed,
        created_utc=artifact.created_utc[:19] + " UTC",
        git=(artifact.git_commit[:12] or "unknown") + (" with changes" if artifact.git_dirty else ""),
        command=artifact.command,
        parents=[(str(parent.id), parent.content_sha256) for parent in artifact.parents],
        packages=", ".join(f"{name} {version}" for name, version in sorted(artifact.packages.items())),
    )


def _recipes(material: Material) -> list[RecipeText]:
    """List every recipe once, with the artifacts made from it."""
    by_hash: dict[str, list[Artifact]] = {}
    for artifact in (*(exhibit.artifact for exhibit in material.exhibits), *material.sweeps):
        by_hash.setdefault(artifact.recipe_sha256, []).append(artifact)
    return [
        RecipeText(made[0].recipe_name, sha256, as_toml(made[0].recipe), [str(one.id) for one in made])
        for sha256, made in by_hash.items()
    ]


def as_toml(recipe: Mapping[str, Any]) -> str:
    """Write a recipe as a file for `skill pretrain`; unset values are left out."""
    plain = {key: value for key, value in recipe.items() if not isinstance(value, dict)}
    parts = ["\n".join(_line(key, value) for key, value in plain.items() if value is not None)]
    for key, section in recipe.items():
        if isinstance(section, dict):
            lines = [_line(name, value) for name, value in section.items() if value is not None]
            parts.append("\n".join([f"[{_toml_key(key)}]", *lines]))
    return "\n\n".join(parts) + "\n"


def _line(key: str, value: Any) -> str:
    return f"{_toml_key(key)} = {_toml(value)}"


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(_line(key, item) for key, item in value.items() if item is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key)
