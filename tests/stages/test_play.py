"""What `skill play` stores: shown, drawn, checked, repeated as a plan; and what a plan by hand refuses."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from command import made, skill
from rich.console import Console

from skillcli.cli.tables import table_of
from skillcli.evaluation.consistency import check_meaning
from skillcli.evaluation.library import open_library
from skillcli.kinds import PLAY
from skillcli.robots.config import bundled_file
from skillcli.stages.play import store_take
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.store.results import complaints
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.take import Take

pytestmark = pytest.mark.slow  # an arm is simulated and drawn

SHIPPED = Path(__file__).parents[2] / "artifacts"
SOURCE = ArtifactId("reference-reach", "embed-means", 1)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("play") / "artifacts"
    for name in ("reference-reach", "reference-point"):
        shutil.copytree(SHIPPED / name, folder / name)
    return folder


def played(store: Path, robot: str = "") -> Artifact:
    """A latent for half a second, then skill 2 for a second, with a gain that drops on the way."""
    library, takes = open_library(Store(store), Store(store).read(SOURCE)), list[Take]()
    session = PlaySession(library, takes.append)
    if robot:
        session.set_robot(robot)
    session.set_goal(library.goals[1])
    session.record()
    session.hold_latent(np.array([0.3, -0.4, 0.5]))
    for _ in range(10):
        session.step()
    session.hold_skill(1)
    for _ in range(20):
        session.step()
    session.close()
    return store_take(Store(store), SOURCE, library, takes[0], "skill play", "by-hand")


@pytest.fixture(scope="module")
def play(store: Path) -> Artifact:
    return played(store)


def test_it_is_checked_like_every_artifact(store: Path, play: Artifact) -> None:
    check_meaning(play)
    assert not list(complaints("play", play.results, play.measured))
    assert Store(store).verify(play.id) == []
    assert PLAY.results_of(play).json() == play.results and PLAY.measured_of(play).json() == play.measured
    assert play.arrays["trajectories/latent"].shape == (1, 30, 3)
    assert played(store).content_sha256 == play.content_sha256, "the same play has the same hash"


def test_it_is_shown_and_drawn(store: Path, play: Artifact, tmp_path: Path) -> None:
    assert skill("--store", store, "show", str(play.id)).code == 0
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(table_of(play))
    said = console.export_text()
    assert "reference-reach/embed-means-v1, by hand" in said and "reached" in said and "1.50 s" in said
    drawn = made("--store", store, "viz", str(play.id), "-o", tmp_path / "a.rrd", "--png", tmp_path / "a.png")
    assert any("world/model" in entity for entity in drawn["entities"]) and (tmp_path / "a.png").stat().st_size > 20_000
    assert any(entity.endswith("world/waypoints/centers") for entity in drawn["entities"])


def test_compose_repeats_it_by_its_id(store: Path, play: Artifact) -> None:
    goal = ",".join(str(x) for x in play.arrays["waypoints/target"][0])
    words = ("compose", str(SOURCE), "--method", "sequence", "--plan", "by-hand/play-v1", "--goal", goal)
    told = made("--store", store, *words)
    again = Store(store).read(ArtifactId.parse(told["id"]))
    for name in ("joint_position", "latent", "skill", "action"):
        np.testing.assert_array_equal(again.arrays[f"trajectories/{name}"], play.arrays[f"trajectories/{name}"])
    assert told["final_distance_m"] == play.results["final_distance_m"]


def test_a_play_of_other_skills_is_refused(store: Path, play: Artifact) -> None:
    result = skill("--store", store, "compose", "reference-point/embed-means", "--method", "sequence", "--plan", str(play.id))
    assert result.code == 1 and "made with other skills" in result.err
    result = skill("--store", store, "compose", str(SOURCE), "--method", "sequence", "--plan", "nobody/play-v1")
    assert result.code == 1 and "no artifact 'nobody/play-v1'" in result.err


def test_one_on_another_robot_says_which(store: Path, tmp_path: Path) -> None:
    bundled = bundled_file("sawyer")
    file = tmp_path / "other.toml"
    file.write_text(bundled.read_text().replace('model = "', f'model = "{bundled.parent}/', 1))
    artifact = played(store, str(file))
    assert artifact.results["robot"]["name"] == "other" and artifact.measured["robot_file"] == str(file)
    assert made("--store", store, "viz", str(artifact.id), "-o", tmp_path / "b.rrd")["entities"]
