"""Recordings as data sets of Minari, loaded back by Minari."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import made, skill

import skillcli
from skillcli.store import Store

REFERENCE = Path(skillcli.__file__).parents[1] / "artifacts"
SOURCES = ("reference-reach/compose-v1", "reference-push/compose-v2", "reference-point/embed-means-v1")


@pytest.mark.parametrize("source", SOURCES)
def test_minari_reads_what_is_stored(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari")
    store = Store(REFERENCE)
    stored = store.read(store.resolve(source))
    report = made("--store", REFERENCE, "export", source, "--minari", tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = minari.load_dataset(report["dataset_id"])
    recording, metadata = stored.group("trajectories"), data.storage.metadata
    assert data.total_episodes == report["episodes"] == len(recording["length"])
    assert data.total_steps == recording["length"].sum()
    assert metadata["fps"] == pytest.approx(20.0) and metadata["content_sha256"] == stored.content_sha256
    for number, episode in enumerate(data.iterate_episodes()):
        steps = recording["length"][number]
        assert np.array_equal(episode.actions, recording["action"][number, :steps])
        assert np.array_equal(episode.rewards, recording["reward"][number, :steps])
        assert np.array_equal(episode.infos["latent"][:steps], recording["latent"][number, :steps])
        assert episode.truncations.tolist() == [False] * (steps - 1) + [True] and not episode.terminations.any()
        for name, values in episode.observations.items():
            described = metadata["fields"][name]
            assert values.shape == (steps + 1, described["size"]) and len(described["names"]) == described["size"]
            if name in recording:
                assert np.array_equal(values, recording[name][number, : steps + 1])
    assert metadata["fields"]["action"]["unit"] == ("m" if "point" in source else "rad")
    assert metadata["fields"]["desired_goal"] == {"unit": "m", "names": ["x", "y", "z"], "size": 3}
    again = skill("--store", REFERENCE, "export", source, "--minari", tmp_path)
    assert again.code == 2 and "exists already" in again.err
    assert not list(tmp_path.glob(".skill-*"))


def test_only_one_form_is_written(tmp_path: Path) -> None:
    words = ("--store", REFERENCE, "export", "reference-reach/compose-v1", "--minari", tmp_path, "-o", tmp_path / "x.tar")
    result = skill(*words)
    assert result.code == 2 and "-o and --minari write different files" in result.err and not list(tmp_path.iterdir())
