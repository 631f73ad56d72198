"""Small artifacts of every kind, made up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillcli.store import Draft, Store

T, D, K = 4, 3, 5
EPISODES = {"pretrain": 5, "embed-means": 7, "compose": 2, "transfer-eval": 10}


def trajectories(rng: np.random.Generator, episodes: int) -> dict[str, Any]:
    return {
        "trajectories/time": np.arange(T + 1) * 0.05,
        "trajectories/latent": rng.normal(size=(episodes, T, D)).astype(np.float32),
        "trajectories/skill": np.full((episodes, T), -1),
        "trajectories/action": rng.normal(size=(episodes, T, 2)),
        "trajectories/reward": rng.normal(size=(episodes, T)),
        "trajectories/target": rng.normal(size=(episodes, 3)),
        "trajectories/success": np.arange(episodes) % 2 == 0,
        "trajectories/length": np.full(episodes, T),
        "trajectories/position": rng.normal(size=(episodes, T + 1, 2)),
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
            "plan/route": np.array([0, 0, 1]),
            "waypoints/route": np.array([0, 1]),
            "waypoints/target": rng.random((2, 3)),
            "waypoints/closest": rng.random(2),
        },
        "transfer-eval": {
            "domains/heavy/mass": rng.random(6),
            "domains/late/delay": rng.random((4, 2)),
            "episodes/domain": np.repeat([0, 1], [6, 4]),
            "episodes/final_distance": rng.random(10),
            "episodes/return": rng.random(10),
            "episodes/energy": rng.random(10),
        },
    }
    return {**special[kind], **trajectories(rng, EPISODES[kind])}


def results(kind: str) -> dict[str, Any]:
    skill, distances = {"name": "1", "final_distance_m": 0.1}, {"mean": 0.1, "median": 0.1, "p90": 0.2}
    latents, point = {"mean": [0.0] * D, "std": [1.0] * D}, [0.0, 0.1, 0.2]
    between = {"from": "1", "to": "2", "final_distance_m": 0.1, "moved_m": point}
    angles = {"direction_error_deg": float("nan"), "magnitude_ratio": None}
    outcome = {"success_rate": 0.5, "ci95": [0.0, 1.0], "final_distance_m": distances, "retention": None, "parameters": {}}
    separated = {"latent_goal_correlation": 0.9, "efficiency": None, "inference_accuracy": 1.0}
    special: dict[str, dict[str, Any]] = {
        "pretrain": {
            "env_steps": 100,
            "skills": [{**skill, "goal": point, "success_rate": 0.5}] * K,
            "embedding": separated,
        },
        "embed-means": {"skills": [{**skill, **latents}] * K, "halfway": [{**between, **angles}] * 2, **separated},
        "compose": {
            "method": "search",
            "task": "goals",
            "success": False,
            "routes": 2,
            "expanded_nodes": 3,
            "simulated_robot_seconds": 1.5,
            "plan_seconds": 3.0,
            "segments": [{"skill": "1", "latent": [0.0] * D, "seconds": 1.0, "route": route} for route in (0, 0, 1)],
            "waypoints": [{"target": point, "closest_m": 0.1, "route": route} for route in (0, 1)],
            "final_distance_m": 0.2,
            "final_distances_m": [0.1, 0.2],
        },
        "transfer-eval": {
            "source": {"success_rate": 1.0, "episodes": 2, "final_distance_m": 0.1},
            "domains": [
                {"name": "heavy", "episodes": 6, "successes": 3, **outcome},
                {"name": "late", "episodes": 4, "successes": 2, **outcome},
            ],
        },
    }
    return {"success_rate": 0.5, "worst": float("nan"), **special[kind]}


def measured(kind: str) -> dict[str, Any]:
    speed = {"env_steps_per_second": 1e4, "sampling_ratio": None, "training_ratio": None}
    special: dict[str, dict[str, Any]] = {"pretrain": {"throughput": speed}, "compose": {"planning_seconds": 0.5}}
    return {"wall_seconds": 1.5, **special.get(kind, {})}


def draft(kind: str = "embed-means", name: str = "run", seed: int = 0, **changes: Any) -> Draft:
    given = {
        "kind": kind,
        "name": name,
        "seed": seed,
        "command": f"skill {kind} --seed {seed}",
        "recipe": {"name": "smoke", "rate": 1e-3, "layers": [8, 8]},
        "arrays": arrays(kind, seed),
        "results": results(kind),
        "measured": measured(kind),
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
