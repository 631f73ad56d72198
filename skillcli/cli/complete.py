"""Shell completion of ids. It reads file names only and imports nothing slow."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import typer


def ids(context: typer.Context, incomplete: str) -> list[str]:
    """Return the ids that begin with the text; without a slash in it, names alone."""
    found = sorted(_stored(_root(context)))
    if "/" not in incomplete:
        names = list(dict.fromkeys(one.split("/")[0] for one in found if one.startswith(incomplete)))
        if len(names) > 1:
            return [f"{name}/" for name in names]
    return [one for one in found if one.startswith(incomplete)]


def _root(context: typer.Context) -> Path:
    given = context.find_root().params.get("store")
    return Path(given or os.environ.get("SKILL_STORE") or "artifacts")


def _stored(root: Path) -> Iterator[str]:
    for path in root.glob("*/*-v*.h5"):
        if not path.name.startswith(".") and not path.parent.name.startswith("."):
            yield f"{path.parent.name}/{path.stem}"
