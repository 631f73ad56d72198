"""What a plan is expected to do when it is sent blindly: said with the plan, from robots that a transfer does not meet."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import made, skill
from worlds import JOINTS

from skillcli.evaluation.prediction import ROBOTS
from skillcli.evaluation.transfer_evaluator import TargetRobots
from skillcli.simulation.domains import find_domain
from skillcli.store import ArtifactId, Store

QUICK = ("--set", "search.budget=3")


@pytest.fixture
def store(chain: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(chain, tmp_path / "artifacts"))


def composed(store: Path, goal: str, *words: str) -> dict[str, Any]:
    return made("--store", store, "compose", "tiny/embed-means", f"--goal={goal}", *QUICK, *words)


def test_robots_are_other_ones_than_a_transfer_draws() -> None:
    domain = find_domain("real-like")
    ahead = TargetRobots.drawn(domain, ROBOTS, 0, JOINTS, use="predicted").parameters["gain"]
    met = TargetRobots.drawn(domain, ROBOTS, 0, JOINTS).parameters["gain"]
    assert ahead.shape == met.shape and not np.isin(ahead, met).any()


def test_on_the_nominal_robot_every_copy_does_what_the_plan_does(store: Path) -> None:
    far = composed(store, "0.6,0.1,0.2", "--set", "compose.robots=nominal")
    assert far["predicted"] == {
        "domain": "nominal", "robots": ROBOTS, "successes": 0, "successes_within_limits": 0, "success_rate": 0.0,
        "ci95": far["predicted"]["ci95"],
    }  # fmt: skip
    assert not far["success"] and far["predicted"]["ci95"][0] == 0 < far["predicted"]["ci95"][1] < 0.1
    start = Store(store).read(ArtifactId.parse(far["id"])).arrays["trajectories/gripper_position"][0, 0]
    near = composed(store, ",".join(f"{x:.3f}" for x in start), "--set", "compose.robots=nominal")
    assert near["success"]
    assert near["predicted"]["successes"] == near["predicted"]["successes_within_limits"] == ROBOTS


def test_another_domain_is_another_composition_and_an_unknown_one_is_refused(store: Path) -> None:
    first = composed(store, "0.6,0.1,0.2")
    assert first["predicted"]["domain"] == "real-like"
    refused = skill("--store", store, "compose", "tiny/embed-means", "--goal=0.6,0.1,0.2", "--set", "compose.robots=none")
    assert refused.code == 2 and "no domain 'none'" in refused.err


def test_a_plan_that_will_fail_says_how_to_go_on(store: Path) -> None:
    told = skill("--store", store, "compose", "tiny/embed-means", "--goal=0.6,0.1,0.2", *QUICK)
    assert told.code == 0 and f"sent blindly to real-like robots, 0 of {ROBOTS} succeed (0%–9%)" in told.out
    assert "look on the way: skill transfer-eval --replan" in told.out
    by_hand = skill(
        "--store", store, "compose", "tiny/embed-means", "--goal=0.6,0.1,0.2", "--method", "sequence", "--plan", "1"
    )
    assert by_hand.code == 0 and "search and mpc can --replan on the way" in by_hand.out
