"""Unfinished training on disk, resumed to the same result. A checkpoint has no id and is replaced in place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skillcli.errors import StoreError
from skillcli.store.atomic import make_folder, storage_errors, sync_folder, write_atomically
from skillcli.store.canonical_json import canonical, parse
from skillcli.store.container import RECORD, Array, Contents, checked_arrays, pack, reading, text_array, unpack
from skillcli.store.provenance import package_versions

_HEADER = {"kind": "checkpoint", "schema_version": 1}
_STATE = f"{RECORD}/state"
_PACKAGES = "packages"


def save_checkpoint(path: Path, arrays: Mapping[str, Array], state: Mapping[str, Any]) -> None:
    """Write everything that training needs to resume, replacing the checkpoint before.

    Args:
        path: see `Store.checkpoint_path`.
        arrays: by path, any shapes.
        state: JSON values, numbers finite; integers of up to 40 digits are exact.

    Raises:
        StoreError: it cannot be stored; the checkpoint before it is kept.
    """
    try:
        text = canonical(state)
    except (TypeError, ValueError) as error:
        raise StoreError(f"the state of training cannot be stored as JSON: {error}") from error
    contents = Contents({}, {**checked_arrays(arrays), _STATE: text_array(text)})
    data = pack({**_HEADER, _PACKAGES: package_versions()}, contents, _labels, gzip=False)  # short-lived: speed first
    with storage_errors(f"write in {path.parent}"):
        make_folder(path.parent)
    write_atomically(path, data, load_checkpoint, replace=True)


def load_checkpoint(path: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the state that were saved.

    Raises:
        StoreError: there is no checkpoint, it is damaged, or other package versions made it: training would reach another
            result, and a saved simulator state is invalid in another version.
    """
    _, contents = unpack(path, _check)
    arrays = dict(contents.arrays)
    with reading(path):
        state = parse(arrays.pop(_STATE).tobytes())
        if not isinstance(state, dict):
            raise ValueError("its state is not a JSON object")
        return arrays, state


def remove_checkpoint(path: Path) -> None:
    """Remove a checkpoint, if there is one.

    Raises:
        StoreError: the disk refuses.
    """
    with storage_errors(f"remove {path}"):
        if path.exists():
            path.unlink()
            sync_folder(path.parent)


def _labels(_: str, ndim: int) -> tuple[str, str]:
    return ",".join(f"axis{i}" for i in range(ndim)), ""


def _check(header: Mapping[str, Any], *_: object) -> None:
    found = {name: header.get(name) for name in _HEADER}
    if found != _HEADER:
        raise StoreError(f"expected a checkpoint as {_HEADER}, got {found}", "start training anew")
    _check_packages(header.get(_PACKAGES))


def _check_packages(made: Any) -> None:
    ours = package_versions()
    before = made if isinstance(made, dict) else {}
    if before != ours:
        names = sorted(name for name in {*before, *ours} if before.get(name) != ours.get(name))
        raise StoreError(
            f"the checkpoint was made with {', '.join(f'{name} {before.get(name)}' for name in names)}",
            "install that, or start anew: without --resume, or after removing the checkpoint",
        )
