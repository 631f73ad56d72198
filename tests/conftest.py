"""One tiny chain on the Sawyer, trained once and read by all tests that need artifacts."""

from __future__ import annotations

from pathlib import Path

import pytest
from command import TINY_SET, skill


@pytest.fixture(scope="session")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with tiny/pretrain-v1, embed-means-v1, compose-v1 and transfer-eval-v1; tests must not change it."""
    store = tmp_path_factory.mktemp("chain") / "artifacts"
    result = skill("--store", store, "run", "smoke", "--name", "tiny", *TINY_SET)
    assert result.code == 0, result.err
    return store
