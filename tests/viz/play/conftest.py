"""The libraries that are played: those of the repository."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.evaluation.library import Library, open_library
from skillcli.store import ArtifactId, Store

STORE = Path(__file__).parents[3] / "artifacts"


def library_of(name: str) -> Library:
    store = Store(STORE)
    return open_library(store, store.read(ArtifactId(name, "embed-means", 1)))


@pytest.fixture(scope="module")
def reach() -> Library:
    return library_of("reference-reach")


@pytest.fixture(scope="module")
def push() -> Library:
    return library_of("reference-push")


@pytest.fixture(scope="module")
def point() -> Library:
    return library_of("reference-point")
