"""What `run` takes for finished work: only what was made from the same recipe, seed and parents by its own account."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command import CHAIN
from forge import forge

from skillcli.recipe import Recipe, resolve
from skillcli.stages.chain import Link, run_chain
from skillcli.store import Artifact, ArtifactId, Parent, Store

pytestmark = pytest.mark.slow

POINT = resolve(
    {
        "name": "tiny",
        "task": {"name": "point", "horizon": 8},
        "embedding": {"size": 2},
        "training": {"iterations": 1, "simulations": 8},
        "evaluation": {"latents": 2, "stored": 1},
        "search": {"budget": 4},
        "compose": {"task": "triangle"},
        "transfer": {"domains": ["nominal", "mild"], "episodes": 2},
    }
)


def ran(store: Store, seed: int = 0, recipe: Recipe = POINT) -> list[Link]:
    return list(run_chain(store, recipe, seed, "tiny", "test"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with one chain of seed 0; tests must not change it."""
    folder = tmp_path_factory.mktemp("finished") / "artifacts"
    ran(Store(folder))
    return folder


def test_what_is_finished_is_used_again(finished: Path, tmp_path: Path) -> None:
    store = Store(shutil.copytree(finished, tmp_path / "artifacts"))
    again = ran(store)
    assert [link.reused for link in again] == [True] * 4
    assert [str(link.artifact.id) for link in again] == [f"tiny/{stage}-v1" for stage in CHAIN]


def test_a_training_that_claims_the_inputs_of_another_is_not_taken_for_it(finished: Path, tmp_path: Path) -> None:
    store = Store(shutil.copytree(finished, tmp_path / "artifacts"))
    good = store.read(ArtifactId("tiny", "pretrain", 1))
    other = next(iter(run_chain(store, POINT, 77, "other", "test"))).artifact
    forged = forge(store, other, id=ArtifactId("tiny", "pretrain", 9), inputs_sha256=good.inputs_sha256)
    assert set(store.find("pretrain", good.inputs_sha256, "tiny")) == {good.id, forged}
    first = ran(store)[0]
    assert first.reused and first.artifact.id == good.id
    store.path(good.id).unlink()
    made = next(iter(run_chain(store, POINT, 0, "tiny", "test")))
    assert not made.reused and made.artifact.content_sha256 == good.content_sha256


def scaled(path: str) -> Callable[[Artifact], dict[str, Any]]:
    return lambda one: {"arrays": {**one.arrays, path: one.arrays[path] * 0.5}}


def other_recipe(key: str) -> Callable[[Artifact], dict[str, Any]]:
    return lambda one: {"recipe": resolve(one.recipe, [key]).model_dump(mode="json")}


def other_parent(one: Artifact) -> dict[str, Any]:
    return {"parents": (Parent(one.parents[0].id, "0" * 64),)}


def results(**changes: Any) -> Callable[[Artifact], dict[str, Any]]:
    return lambda one: {"results": {**one.results, **changes}}


@pytest.mark.parametrize(
    ("stage", "change"),
    [
        ("pretrain", lambda one: {"seed": 1}),
        ("pretrain", other_recipe("training.learning_rate=0.002")),
        ("pretrain", lambda one: {"model_sha256": "0" * 64}),
        ("pretrain", lambda one: {"content_sha256": "0" * 64}),
        ("pretrain", scaled("skills/goal")),
        ("embed-means", other_parent),
        ("compose", other_parent),
        ("compose", scaled("waypoints/target")),
        ("compose", other_recipe("search.budget=5")),
        ("compose", results(task="goals")),
        ("compose", results(method="mpc")),
        ("compose", results(on="mild")),
        ("transfer-eval", other_parent),
        ("transfer-eval", lambda one: {"seed": 1}),
        ("transfer-eval", scaled("domains/mild/gain")),
        ("transfer-eval", results(robot={"file": "x", "fingerprint": "y"})),
    ],
)
def test_what_is_not_made_from_these_inputs_is_made_anew(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, change: Callable[[Artifact], dict[str, Any]]
) -> None:
    store = Store(shutil.copytree(finished, tmp_path / "artifacts"))
    good = store.read(ArtifactId("tiny", stage, 1))
    forge(store, good, **change(good))
    assert store.find(stage, good.inputs_sha256, "tiny") == [good.id], "it still claims to be"
    for link in run_chain(store, POINT, 0, "tiny", "test"):
        if link.artifact.kind == stage:
            assert not link.reused and link.artifact.id.version == 2
            assert link.artifact.content_sha256 == good.content_sha256
            return
    raise AssertionError(stage)
