"""Two tiny chains on the Sawyer, each trained once and read by all tests that need artifacts."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command import PLACES, TINY_PUSH, TINY_PUSH_SET, TINY_SET, made, skill

from skillcli.recipe import load_recipe
from skillcli.stages.compose import Request, compose
from skillcli.store import ArtifactId, Store
from skillcli.tasks.world import place_goal as goal_place

TRAINED = {"chain", "push_chain"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever needs a trained chain or waits for a clock is slow; what is slow for another reason says so itself."""
    for item in items:
        trained = isinstance(item, pytest.Function) and TRAINED & set(item.fixturenames)
        if trained or item.get_closest_marker("real_time"):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session", autouse=True)
def surroundings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests neither use the user's cache nor the size of a terminal, in processes that they start neither."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, "XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        for size in ("COLUMNS", "LINES"):
            patch.delitem(os.environ, size, raising=False)
        yield


@pytest.fixture(scope="session")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with tiny/pretrain-v1, embed-means-v1, compose-v1 and transfer-eval-v1; tests must not change it."""
    store = tmp_path_factory.mktemp("chain") / "artifacts"
    result = skill("--store", store, "run", "smoke", "--name", "tiny", *TINY_SET)
    assert result.code == 0, result.err
    return store


@pytest.fixture(scope="session")
def push_chain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with pushed/pretrain-v1 and so on, composed of the routes of `PLACES`; tests must not change it."""
    folder = tmp_path_factory.mktemp("push_chain") / "artifacts"
    made("--store", folder, "pretrain", "push", "--name", "pushed", *TINY_PUSH_SET)
    made("--store", folder, "embed-means", "pushed/pretrain")
    store, recipe = Store(folder), load_recipe("push", TINY_PUSH)
    routes = tuple(np.array([goal_place(recipe.task, goal) for goal in route]) for route in PLACES)
    compose(store, ArtifactId("pushed", "embed-means", 1), recipe, Request("places", routes), "search", "test")
    made(
        "--store", folder, "transfer-eval", "pushed/compose", "--domain", "nominal", "--domain", "real-like", "--episodes", "7"
    )
    return folder
