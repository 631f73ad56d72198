"""Small artifacts of every kind, made up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillcli.store import Draft, Store

E, T, D, K = 2, 4, 3, 5


def trajectories(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "trajectories/time": np.arange(T + 1) * 0.05,
        "trajectories/latent": rng.normal(size=(E, T, D)).astype(np.float32),
        "trajectories/skill": np.full((E, T), -1),
        "trajectories/action": rng.normal(size=(E, T, 2)),
        "trajectories/reward": rng.normal(size=(E, T)),
        "trajectories/target": rng.normal(size=(E, 3)),
        "trajectories/success": np.array([True, False]),
        "trajectories/length": np.array([T, T]),
        "trajectories/position": rng.normal(size=(E, T + 1, 2)),
    }


def embedding(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "embedding/mean": rng.normal(size=(K, D)),
        "embedding/std": np.full((K, D), 0.5),
        "skills/goal": rng.normal(size=(K, 3)),
    }


def arrays(kind: str, seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    special: dict[str, dict[str, Any]] = {
        "pretrain": {
            "weights/policy/0.weight": rng.normal(size=(7, 6)).astype(np.float32),
            "weights/policy/log_std": np.float32(0.5),
            "curves/return": rng.normal(size=9),
            "evaluation/final_distance": rng.random((K, 6)),
            "evaluation/latent": rng.normal(size=(K, 6, D)),
            "evaluation/inferred": rng.normal(size=(K, 6, D)),
            **embedding(rng),
        },
        "embed-means": {
            "embedding/bounds": rng.normal(size=(2, D)),
            "embedding/latent_distance": rng.random((K, K)),
            "embedding/goal_distance": rng.random((K, K)),
            "halfway/pair": np.array([[0, 1], [1, 2]]),
            **embedding(rng),
        },
        "compose": {
            "plan/latent": rng.normal(size=(3, D)),
            "plan/seconds": np.ones(3),
            "plan/skill": np.arange(3),
            "plan/route": np.zeros(3, int),
            "waypoints/route": np.zeros(0, int),
            "waypoints/target": np.empty((0, 3)),
            "waypoints/closest": np.empty(0),
        },
        "transfer-eval": {
            "domains/heavy/mass": rng.random(6),
            "domains/late/delay": rng.random((4, 2)),
            "episodes/domain": np.arange(10) % 2,
            "episodes/final_distance": rng.random(10),
            "episodes/return": rng.random(10),
            "episodes/energy": rng.random(10),
        },
    }
    return {**special[kind], **trajectories(rng)}


def draft(kind: str = "embed-means", name: str = "run", seed: int = 0, **changes: Any) -> Draft:
    given = {
        "kind": kind,
        "name": name,
        "seed": seed,
        "command": f"skill {kind} --seed {seed}",
        "recipe": {"name": "smoke", "rate": 1e-3, "layers": [8, 8]},
        "arrays": arrays(kind, seed),
        "results": {"success_rate": 0.5, "worst": float("nan")},
        "measured": {"wall_seconds": 1.5},
        "model_sha256": "m" * 64,
        "inputs_sha256": f"{seed:064d}",
    }
    return Draft(**{**given, **changes})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "artifacts")


@pytest.fixture
def make() -> Callable[..., Draft]:
    return draft
