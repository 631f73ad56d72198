"""What the latent space is worth as a map: of a tiny library, and of ends worked out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import TINY_SET, made, skill

from skillcli.evaluation.map_quality import PLACES, JudgedMap
from skillcli.hull import Hull
from skillcli.store import Store

MIXED = ("--set", "mixtures.share=0.5", "--set", 'mixtures.weights="multilinear"')


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A store with a tiny library that was trained with mixtures and its means, and what embed-means reports."""
    store = tmp_path_factory.mktemp("mixed") / "artifacts"
    made("--store", store, "pretrain", "reach", "--name", "mixed", *TINY_SET, *MIXED)
    return store, made("--store", store, "embed-means", "mixed/pretrain")


def test_distances_of_the_ends_from_the_places() -> None:
    place = np.zeros((5, 3))
    end = np.array([[0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03], [0.04, 0, 0], [0.03, 0.04, 0]])
    found = JudgedMap(place, np.arange(5.0)[:, None], end).quality
    assert found.places == 5 and found.max_m == pytest.approx(0.05) and found.median_m == pytest.approx(0.03)
    assert found.p90_m == pytest.approx(0.046) and found.p95_m == pytest.approx(0.048)


def test_latents_that_lie_as_their_ends_do_correlate_fully() -> None:
    end = np.random.default_rng(0).random((20, 3))
    assert JudgedMap(end, 7 * end[:, ::-1], end).quality.latent_end_correlation == pytest.approx(1)


@pytest.mark.slow
def test_embed_means_judges_the_map_of_skills_that_were_trained_with_mixtures(mixed: tuple[Path, dict[str, Any]]) -> None:
    store, found = mixed
    artifact = Store(store).read(Store(store).resolve(found["id"]))
    place, latent, end = (artifact.arrays[f"map/{name}"] for name in ("place", "latent", "end"))
    goals, mean = artifact.arrays["skills/goal"], artifact.arrays["embedding/mean"]
    assert found["map"]["places"] == len(place) == PLACES
    assert (place >= goals.min(axis=0)).all() and (place <= goals.max(axis=0)).all()
    np.testing.assert_allclose(latent, Hull(goals).weights(place) @ mean)
    distance = np.linalg.norm(end - place, axis=1)
    assert found["map"]["median_m"] == pytest.approx(np.median(distance))
    assert found["map"]["max_m"] == pytest.approx(distance.max())
    assert made("--store", store, "verify", found["id"])["ok"]
    there = found["map"]["on_robots"]
    distance = np.linalg.norm(artifact.arrays["map/end_on_robots"] - place, axis=1)
    assert there["domain"] == "real-like" and there["median_m"] == pytest.approx(np.median(distance))
    assert there["p90_m"] <= there["p95_m"] <= there["max_m"] == pytest.approx(distance.max())
    assert not np.allclose(artifact.arrays["map/end_on_robots"], end)


@pytest.mark.slow
def test_the_same_library_is_judged_by_the_same_places(mixed: tuple[Path, dict[str, Any]]) -> None:
    store, found = mixed
    again = skill("--store", store, "embed-means", "mixed/pretrain", "--name", "again")
    assert again.code == 0 and f"map: {PLACES} places between the goals" in again.out
    assert "each on a robot of real-like: median" in again.out
    hashes = [made("--store", store, "show", id_)["content_sha256"] for id_ in (found["id"], "again/embed-means")]
    assert hashes[0] == hashes[1]


@pytest.mark.slow
def test_the_figure_shows_where_the_latents_of_the_map_end(mixed: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    store, found = mixed
    made("--store", store, "viz", found["id"], "-o", tmp_path / "x.rrd", "--png", tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 1000


@pytest.mark.slow
def test_without_mixtures_there_is_no_map_to_judge(chain: Path) -> None:
    found = made("--store", chain, "show", "tiny/embed-means")
    assert "map" not in found["results"] and not any(path.startswith("map/") for path in found["arrays"])
