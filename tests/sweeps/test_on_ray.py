"""Cells on Ray: the same results as here, and a node that dies loses and doubles nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from command import TINY_SET, made

from skillcli.store import ArtifactId, Store

ray = pytest.importorskip("ray")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # starts nodes, and trains

CODE = "import sys; sys.argv[0] = 'skill'; from skillcli.cli.main import main; main()"
ASKED = ("sweep", "smoke", *TINY_SET[2:], "--set", "training.iterations=2,3", "--name", "grid")


def contents(store: Path, found: Any) -> list[str]:
    return [Store(store).header(ArtifactId.parse(cell["id"])).content_sha256 for cell in found["cells"]]


def test_ray_on_this_machine_gives_the_same_and_a_node_that_dies_loses_nothing(tmp_path: Path) -> None:
    from ray.cluster_utils import Cluster

    here, there = tmp_path / "here", tmp_path / "there"
    local = made("--store", here, *ASKED, "--seeds", "0-1", "--jobs", "2")
    cluster = Cluster(
        initialize_head=True,
        head_node_args={"num_cpus": 1, "object_store_memory": 100_000_000, "env_vars": {"SKILL_STORE": str(tmp_path / "one")}},
    )
    try:
        doomed = cluster.add_node(num_cpus=1, object_store_memory=100_000_000, env_vars={"SKILL_STORE": str(tmp_path / "two")})
        process = subprocess.Popen(
            [sys.executable, "-c", CODE, "--store", str(there), "--json", *ASKED, "--seeds", "0-1", "--ray", cluster.address],
            stdout=subprocess.PIPE,
            text=True,
            env={name: value for name, value in os.environ.items() if name != "SKILL_STORE"},
        )
        until = time.monotonic() + 300
        while not list((tmp_path / "two").glob("grid*/pretrain-v1.h5")) and time.monotonic() < until:
            assert process.poll() is None, "all cells ran on one node"
            time.sleep(0.1)
        cluster.remove_node(doomed, allow_graceful=False)
        out, _ = process.communicate(timeout=600)
    finally:
        cluster.shutdown()
    found = json.loads(out)
    assert found["failed"] == 0 and contents(there, found) == contents(here, local)
    assert len(list(there.glob("grid*/pretrain-v*.h5"))) == 4, "none is lost, none is there twice"
    assert made("--store", there, "verify", "--all")["ok"]
    assert not [path for path in there.rglob(".*") if path.name.startswith((".tmp", ".shared"))]
    same = (Store(root).read(ArtifactId.parse("grid/sweep-v1")).content_sha256 for root in (here, there))
    assert len(set(same)) == 1, "wherever it ran"


def test_ray_that_does_not_answer_is_one_line(tmp_path: Path) -> None:
    from command import skill

    told = skill("--store", tmp_path / "store", *ASKED, "--seeds", "0", "--ray", "127.0.0.1:1")
    assert told.code == 1 and "--ray 127.0.0.1:1" in told.err and len(told.err.splitlines()) <= 3
