"""Executions as episodes of one experiment: what counts together, and what is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skillcli import metrics
from skillcli.evaluation.executed import pool
from skillcli.kinds import EXECUTION, TRANSFER_EVAL
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.viz.report.executions import executed

GOLDEN = Store(Path(__file__).parents[1] / "store" / "golden")
ONE = GOLDEN.read(ArtifactId.parse("tiny/execution-v1"))


def execution(number: int, successes: int, episodes: int, far: float = 0.01, seed: int = 0, **results: Any) -> Artifact:
    """An execution like the golden one, whose episodes all end equally far from the goal, m."""
    changed: Mapping[str, Any] = {**ONE.results, "successes": successes, "episodes": episodes, "domain": "mild", **results}
    arrays = {**ONE.arrays, "episodes/final_distance": np.full(episodes, far)}
    identity = ArtifactId.parse(f"tiny/execution-v{number}")
    return replace(ONE, id=identity, created_utc=f"2026-01-{number:02}", seed=seed, results=changed, arrays=arrays)


def test_executions_with_other_seeds_count_together_with_the_interval_of_all_episodes() -> None:
    found = pool([execution(1, 7, 10, far=0.01), execution(2, 10, 10, far=0.03, seed=1), execution(3, 3, 10, far=0.02, seed=2)])
    assert len(found) == 1 and (found[0].successes, found[0].episodes) == (20, 30)
    assert found[0].ci95 == metrics.wilson_interval(20, 30) and found[0].success_rate == pytest.approx(2 / 3)
    assert found[0].median == pytest.approx(0.02) and found[0].p90 == pytest.approx(0.03)
    assert [one.id.version for one in found[0].used] == [3, 2, 1] and not found[0].repeated


def test_the_same_simulated_robots_count_once_and_real_ones_every_time() -> None:
    again = pool([execution(1, 7, 10), execution(2, 8, 10), execution(3, 1, 2)])
    assert [one.id.version for one in again[0].used] == [2] and again[0].episodes == 10
    assert sorted(one.version for one in again[0].repeated) == [1, 3]
    real = pool([execution(1, 7, 10, domain=None, driver="franka"), execution(2, 8, 10, domain=None, driver="franka")])
    assert real[0].episodes == 20 and not real[0].repeated


def test_an_episode_that_somebody_interrupted_is_none_and_one_that_broke_off_by_itself_failed() -> None:
    def stop(reason: str, episode: int) -> dict[str, Any]:
        return {"stopped": {"reason": reason, "message": "", "episode": episode, "seconds": 1.0}}

    counted = [
        (
            pool([execution(1, 3, 4, **stop(reason, episode))])[0].successes,
            pool([execution(1, 3, 4, **stop(reason, episode))])[0].episodes,
        )
        for reason, episode in (("interrupted", 3), ("interrupted", 4), ("stale_reading", 3))
    ]
    assert counted == [(3, 3), (3, 4), (3, 4)]
    assert pool([execution(1, 0, 1, **stop("interrupted", 0))]) == []


def test_what_differs_in_more_than_chance_stays_apart_and_dry_runs_are_none() -> None:
    other = {**ONE.results["robot"], "fingerprint": "f" * 64}
    changes: list[dict[str, Any]] = [{}, {"domain": "real-like"}, {"max_speed": 0.2}, {"replanned": True}, {"robot": other}]
    found = pool(
        [*(execution(n, 1, 2, seed=n, **change) for n, change in enumerate(changes, 1)), execution(9, 0, 2, dry_run=True)]
    )
    assert len(found) == len(changes) and all(one.episodes == 2 for one in found)
    elsewhere = replace(execution(7, 1, 2, seed=7), parents=(replace(ONE.parents[0], content_sha256="a" * 64),))
    assert len(pool([execution(1, 1, 2), elsewhere])) == 2, "another plan"


def material(*artifacts: Artifact) -> Any:
    kinds = {EXECUTION.name: [], TRANSFER_EVAL.name: []}  # type: dict[str, list[Any]]
    for one in artifacts:
        kinds[one.kind].append(SimpleNamespace(artifact=one))
    return SimpleNamespace(find=lambda kind: kinds[kind.name])


def transfer(successes: int, episodes: int) -> Artifact:
    """A transfer of the golden execution's plan to the domain `mild`."""
    golden = GOLDEN.read(ArtifactId.parse("tiny/transfer-eval-v1"))
    interval = list(metrics.wilson_interval(successes, episodes))
    domain = {**golden.results["domains"][0], "name": "mild", "successes": successes, "episodes": episodes, "ci95": interval}
    domain |= {"success_rate": successes / episodes, "deterministic": False}
    return replace(golden, parents=ONE.parents, results={**golden.results, "domains": [domain]})


def test_a_line_says_n_and_interval_and_whether_the_transfer_foresaw_it() -> None:
    twice = execution(1, 9, 10), execution(2, 10, 10, seed=1, stopped=None)
    line = next(executed(material(*twice, transfer(50, 50))))
    assert line.here is not None and line.here.text == "19 of 20 (76–99 %), median 1.0 cm, 90 % within 1.0 cm"
    assert line.what.endswith("(simulation, mild), 2 executions") and line.here.key == "results, with tiny/execution-v1"
    assert line.verdict == "agrees with transfer-eval: 50 of 50"
    worse = execution(3, 2, 10)
    assert next(executed(material(worse, transfer(50, 50)))).verdict == "differs from transfer-eval: 50 of 50"
    assert next(executed(material(worse))).verdict == ""
