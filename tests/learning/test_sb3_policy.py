"""Policies from Stable-Baselines3: read without running anything in the file, and used as a composer."""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from command import made
from sb3_file import FEATURES, LATENT, write_model

from skillcli.errors import UsageError
from skillcli.learning.sb3_policy import read_policy


def model(kind: str, **policy: Any) -> Any:
    sb3 = pytest.importorskip("stable_baselines3")
    gymnasium = pytest.importorskip("gymnasium")

    class Space(gymnasium.Env):  # type: ignore[misc, name-defined]
        observation_space = gymnasium.spaces.Box(-9.0, 9.0, (FEATURES,))
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (LATENT,))

        def reset(self, **_: Any) -> Any:
            return np.zeros(FEATURES, dtype=np.float32), {}

    return getattr(sb3, kind)("MlpPolicy", Space(), policy_kwargs=policy or None, seed=1, device="cpu")


def saved(folder: Path, **change: bytes) -> tuple[Path, str]:
    path = write_model(folder / "model.zip", **change)
    return path, hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("kind", "policy"),
    [
        ("PPO", {}),
        ("PPO", {"activation_fn": torch.nn.ReLU, "net_arch": [16]}),
        ("A2C", {"activation_fn": torch.nn.ELU}),
        ("SAC", {"net_arch": [16]}),
        ("TD3", {"net_arch": [16, 8]}),
    ],
)
def test_actions_are_those_of_stable_baselines(
    kind: str, policy: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "gym", None)  # it looks for OpenAI's, and must not find this folder's neighbour
    trained, path = model(kind, **policy), tmp_path / "model.zip"
    trained.save(path)
    ours = read_policy(path, hashlib.sha256(path.read_bytes()).hexdigest())
    features = np.random.default_rng(0).normal(size=(20, FEATURES)).astype(np.float32)
    theirs, _ = trained.predict(features, deterministic=True)
    assert ours.sizes == (FEATURES, LATENT) and ours(features) == pytest.approx(theirs, abs=1e-5)


def test_nothing_in_a_file_is_run(tmp_path: Path) -> None:
    trap = tmp_path / "sprung"

    class Harm:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(trap),)

    buffer = io.BytesIO()
    torch.save({"action_net.weight": Harm()}, buffer)
    for change in ({"policy": buffer.getvalue()}, {"policy": pickle.dumps(Harm(), protocol=2)}, {"data": pickle.dumps(Harm())}):
        path, digest = saved(tmp_path, **change)
        with pytest.raises(UsageError, match="is not a model that Stable-Baselines3 saved"):
            read_policy(path, digest)
    data = json.dumps(
        {"policy_kwargs": {":serialized:": "gASV", "activation_fn": "<class 'torch.nn.modules.activation.GELU'>"}}
    )
    path, digest = saved(tmp_path, data=data.encode())
    with pytest.raises(UsageError, match="activation function is GELU"):
        read_policy(path, digest)
    assert not trap.exists()


def test_another_file_than_the_settings_name_is_refused(tmp_path: Path) -> None:
    path, digest = saved(tmp_path)
    assert read_policy(path, digest).sizes == (FEATURES, LATENT)
    with pytest.raises(UsageError, match="SHA-256 differs"):
        read_policy(path, "0" * 64)


def test_a_policy_composes_from_the_command_line(chain: Path, tmp_path: Path) -> None:
    store, (path, digest) = shutil.copytree(chain, tmp_path / "artifacts"), saved(tmp_path)
    words = ("compose", "tiny/embed-means", "--goal", "0.6,0.1,0.25", "--set", "sb3.seconds=0.5")
    found = made("--store", store, *words, "--method", f"sb3:{path}")
    assert found["method"] == "sb3" and 1 <= len(found["segments"]) <= 2
    shown = made("--store", store, "show", found["id"])
    assert shown["recipe"]["sb3"]["policy_sha256"] == digest
    assert made("--store", store, "verify", found["id"])["ok"]
