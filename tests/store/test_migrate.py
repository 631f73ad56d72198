"""Files of every schema version there has been, kept in `golden`: read or migrated, the original as it was."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forge import forge

from skillcli import __version__
from skillcli.errors import StoreError
from skillcli.kinds import KINDS
from skillcli.plaintext import markdown
from skillcli.store import ArtifactId, Draft, Store, codec

GOLDEN = Path(__file__).parent / "golden"
PRESENT = {
    "tiny/pretrain-v1": "6cb6a1e9e93718e4",
    "tiny/embed-means-v1": "46cdb0998e6b5fb5",
    "tiny/compose-v1": "e44e8f970b822205",
    "tiny/transfer-eval-v1": "4efbea0fef37fe4c",
    "tiny/execution-v1": "3b80d2a030c15f09",
    "tiny/sweep-v1": "eb137cb15a9ef23c",
    "tiny/play-v1": "b4b051a8564a1456",
}
OLDER = ("reference-point/embed-means-v1", "reference-point/compose-v1")


@pytest.fixture
def golden(tmp_path: Path) -> Store:
    return Store(shutil.copytree(GOLDEN, tmp_path / "golden"))


@pytest.mark.parametrize(("text", "content"), PRESENT.items())
def test_files_of_the_present_schemas_mean_what_they_meant(golden: Store, text: str, content: str) -> None:
    artifact = golden.read(ArtifactId.parse(text))
    assert artifact.schema_version == KINDS[artifact.kind].version
    assert artifact.content_sha256[:16] == content
    assert golden.verify(artifact.id) == []


def test_there_is_a_golden_file_and_a_migration_for_every_version(golden: Store) -> None:
    headers, unreadable = golden.listing()
    assert not unreadable
    assert {(one.kind, one.schema_version) for one in headers} == {
        (kind, version) for kind, known in KINDS.items() for version in range(1, known.version + 1)
    }
    assert all(set(known.migrations) == set(range(1, known.version)) for known in KINDS.values())


@pytest.mark.parametrize("text", OLDER)
def test_an_older_version_is_refused_with_the_way_out_and_migrated_in_one_step(golden: Store, text: str) -> None:
    old = ArtifactId.parse(text)
    before = golden.path(old).read_bytes()
    assert [problem for problem in golden.verify(old) if "parent" not in problem] == []
    with pytest.raises(StoreError, match="older schema 1") as caught:
        golden.read(old)
    assert f"skill migrate {old}" in caught.value.hint

    new = golden.migrate(old, f"skill migrate {old}")
    assert golden.path(old).read_bytes() == before
    assert (new.id.series, new.id.version, new.schema_version) == (old.series, 2, 2)
    assert new.parents == golden.header(old).parents
    assert new.origin["id"] == text and new.origin["schema_version"] == 1
    assert f"migrated from **{markdown(text)}**" in new.provenance()
    assert golden.current(old) == new.id == golden.current(new.id)
    assert golden.find(new.kind, new.inputs_sha256) == [new.id]
    with pytest.raises(StoreError, match="present schema"):
        golden.migrate(new.id, "again")


def test_what_is_added_is_what_the_older_version_meant(golden: Store) -> None:
    plan = golden.migrate(ArtifactId.parse("reference-point/compose-v1"), "")
    assert plan.arrays["plan/route"].tolist() == [0] * 6 and plan.arrays["waypoints/route"].tolist() == [0] * 3
    assert plan.results["routes"] == 1 and plan.results["success_rate"] == 1.0
    assert plan.results["final_distances_m"] == [plan.results["final_distance_m"]]
    assert {segment["route"] for segment in plan.results["segments"]} == {0}
    means = golden.migrate(ArtifactId.parse("reference-point/embed-means-v1"), "")
    assert means.arrays["halfway/pair"].shape == (0, 2) and means.results["halfway"] == []


@pytest.mark.parametrize("success", [np.zeros(0, bool), np.full(1, 1e308), np.zeros((1, 0))], ids=["none", "numbers", "flat"])
def test_an_older_version_that_holds_nonsense_is_refused_in_one_line(golden: Store, success: Any) -> None:
    old = ArtifactId.parse("reference-point/compose-v1")
    read = codec.read_artifact(golden.path(old), old, older=True)
    forge(golden, read, arrays={**read.arrays, "trajectories/success": success})
    (problem,) = golden.verify(old)
    assert "trajectories/success" in problem and "\n" not in problem


def test_a_newer_schema_is_listed_but_refused_with_what_to_install(
    store: Store, make: Callable[..., Draft], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setitem(KINDS, "embed-means", replace(KINDS["embed-means"], version=9, made_from=()))
        newer = store.write(make()).id
    assert [one.id for one in store.headers()] == [newer]
    refusals: list[Callable[[], Any]] = [lambda: store.read(newer), lambda: store.migrate(newer, "")]
    for refused in refusals:
        with pytest.raises(StoreError, match=f"has schema 9, skill {__version__} reads at most 2") as caught:
            refused()
        assert "install a newer skill" in caught.value.hint
    assert store.verify(newer) == [caught.value.message]
    assert store.find("embed-means", make().inputs_sha256) == []
