"""Pinned artifacts: an empty file `NAME/.pins/STAGE-vN` each; the artifact's own file is not touched."""

from __future__ import annotations

from pathlib import Path

from skillcli.store.atomic import make_folder, sync_folder

FOLDER = ".pins"


def is_pinned(path: Path) -> bool:
    """Return whether the artifact in this file is pinned.

    Raises:
        OSError: the folder cannot be read.
    """
    return _pin(path).exists()


def pin(path: Path) -> None:
    """Protect the artifact in this file.

    Raises:
        OSError: the folder cannot be written.
    """
    make_folder(_pin(path).parent)
    _pin(path).touch()
    sync_folder(_pin(path).parent)


def unpin(path: Path) -> None:
    """End the protection, if there is one.

    Raises:
        OSError: the folder cannot be written.
    """
    if is_pinned(path):
        _pin(path).unlink(missing_ok=True)
        sync_folder(_pin(path).parent)


def _pin(path: Path) -> Path:
    return path.parent / FOLDER / path.stem
