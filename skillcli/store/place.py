"""The folder of a store: given, named by the environment, or the usual one."""

from __future__ import annotations

import os
from pathlib import Path

from skillcli.errors import StoreError
from skillcli.store.store import Store

DEFAULT_STORE = "artifacts"  # in the current folder, as for the command line


def store_at(place: Store | str | Path | None) -> Store:
    """Return a store from itself or its folder; None for what SKILL_STORE names, else `artifacts` in the current folder."""
    if isinstance(place, Store):
        return place
    return Store(Path(place if place is not None else os.environ.get("SKILL_STORE") or DEFAULT_STORE))


def filled_store_at(place: Store | str | Path | None) -> Store:
    """Return a store to read from; see `store_at`.

    Raises:
        StoreError: there is no such folder.
    """
    store = store_at(place)
    if not store.root.is_dir():
        raise StoreError(f"there is no store {store.root}", "run in the folder that holds it, or give `store`")
    return store
