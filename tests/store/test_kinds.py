"""Kinds of artifacts: one that is added as docs/artifacts.md says, and records between JSON and dataclasses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from command import CHAIN, made, skill
from rich.table import Table

from skillcli.cli.tables import TABLES, table_of
from skillcli.errors import StoreError
from skillcli.evaluation.consistency import check_meaning
from skillcli.kinds import COMPOSE, EMBED_MEANS, KINDS, ByKind, kind_spec
from skillcli.kinds.arrays import TRAJECTORIES
from skillcli.kinds.record import Record, optional, rest
from skillcli.kinds.spec import Field
from skillcli.store import STAGES, Artifact, ArtifactId, Draft, Store
from skillcli.store.results import complaints
from skillcli.viz.figures import FIGURES, draw
from skillcli.viz.loading import SCENES, Shown, scene_of
from skillcli.viz.recording.layout import LAYOUTS
from skillcli.viz.scene import Runs

Make = Callable[..., Draft]
PAGE = Path(__file__).parents[2] / "docs" / "artifacts.md"


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """What the page adds, known while a test runs."""
    for registry in (TABLES, SCENES, FIGURES, LAYOUTS):
        monkeypatch.setattr(registry, "_known", dict(registry._known))
    text = PAGE.read_text(encoding="utf-8").split("## Add a kind of artifact")[1].split("\n## ")[0]
    space: dict[str, Any] = {}
    for block in re.findall(r"(?:(?<=\n\n)|^)((?:    .*\n|\n)+)", text):
        exec(re.sub(r"^ {4}", "", block, flags=re.MULTILINE), space)
        if "WEAR" in space:
            monkeypatch.setitem(KINDS, "wear", space["WEAR"])
    yield space


@pytest.fixture
def worn(shown: dict[str, Any], chain: Path, tmp_path: Path) -> tuple[Store, Artifact]:
    """A store with a chain and a wear artifact of its composition."""
    store, source = Store(tmp_path / "artifacts"), ArtifactId("tiny", "compose", 1)
    for one in (source, *Store(chain).lineage(source)):
        store.path(one).parent.mkdir(parents=True, exist_ok=True)
        store.path(one).write_bytes(Store(chain).path(one).read_bytes())
    return store, shown["wear"](store, source, "skill wear")


def test_a_kind_of_ones_own_is_written_read_and_verified(worn: tuple[Store, Artifact]) -> None:
    store, artifact = worn
    assert str(artifact.id) == "tiny/wear-v1" and store.resolve("tiny/wear") == artifact.id
    again = store.read(artifact.id)
    assert again.content_sha256 == artifact.content_sha256 and again.arrays["wear/travel"].shape == (1, 7)
    travel = kind_spec("wear").results_of(again).travel_rad
    assert travel == tuple(again.arrays["wear/travel"].sum(axis=0)) and len(travel) == 7
    assert store.verify(artifact.id, check_meaning) == []
    assert [header.kind for header in store.headers()] == ["pretrain", "embed-means", "compose", "wear"]
    with pytest.raises(StoreError, match="made from it"):
        store.remove(ArtifactId("tiny", "compose", 1))


def test_it_has_the_commands_that_every_kind_has(worn: tuple[Store, Artifact]) -> None:
    store, artifact = worn
    listed = made("--store", store.root, "ls", "--kind", "wear")["artifacts"]
    assert [one["id"] for one in listed] == [str(artifact.id)]
    assert made("--store", store.root, "show", "tiny/wear")["results"] == artifact.results
    assert made("--store", store.root, "verify", "tiny/wear")["ok"]
    assert not store.strangers()
    told = skill("--store", store.root, "viz", "tiny/wear")
    assert told.code == 1 and "there is no figure or recording of wear" in told.err
    assert "pretrain, embed-means, compose, transfer-eval" in told.err


def test_what_is_not_as_its_spec_says_is_refused(worn: tuple[Store, Artifact], shown: dict[str, Any]) -> None:
    store, artifact = worn
    kept = {name: getattr(artifact, name) for name in ("seed", "command", "recipe", "measured")}
    draft = Draft(kind="wear", name="odd", arrays=artifact.arrays, results=artifact.results, parents=(), **kept)
    for change, told in (
        ({"results": {}}, "results.travel_rad is missing"),
        ({"results": {"travel_rad": ["far"]}}, "must be a number"),
        ({"arrays": {"wear/travel": -artifact.arrays["wear/travel"]}}, "allowed is 0 to"),
        ({"arrays": {}}, "wear/travel is missing"),
    ):
        with pytest.raises(StoreError, match=re.escape(told)):
            store.write(replace(draft, **change))
    assert shown["WEAR"].made_from == ("compose",)


def test_it_has_the_table_that_was_registered_or_its_results_as_they_are(worn: tuple[Store, Artifact]) -> None:
    _, artifact = worn
    table = table_of(artifact).renderables[1]
    assert isinstance(table, Table) and [column.header for column in table.columns] == ["joint", "travel (rad)"]
    del TABLES._known["wear"]
    assert len(table_of(artifact).renderables) == 2


def test_a_kind_that_records_episodes_can_have_a_figure(
    worn: tuple[Store, Artifact], shown: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    store, _ = worn
    source = store.read(ArtifactId("tiny", "compose", 1))
    ran = replace(shown["WEAR"], fields={**TRAJECTORIES, "trajectories/joint_position": Field("episode,step+1,joint", "rad")})
    monkeypatch.setitem(KINDS, "wear", ran)
    arrays = {f"trajectories/{name}": values for name, values in source.group("trajectories").items()}
    draft = Draft(
        kind="wear", name="tiny", seed=0, command="skill wear", recipe=source.recipe, arrays=arrays, measured={},
        results=shown["WearResults"](travel_rad=(1.0,)).json(), parents=[source.id], model_sha256=source.model_sha256,
    )  # fmt: skip
    artifact = store.write(draft)
    SCENES.register(ran)(lambda *_: Shown(runs=Runs.PLANNED, labels=("worn",)))
    scene = scene_of(store, artifact.id)
    assert scene.kind == "wear" and scene.episode_labels == ("worn",) and len(scene.waypoints)
    with pytest.raises(StoreError, match="there is no figure of wear"):
        draw(scene)
    FIGURES.register(ran)(FIGURES.of("compose"))
    assert draw(scene).axes


def test_without_its_spec_it_is_no_artifact(worn: tuple[Store, Artifact], monkeypatch: pytest.MonkeyPatch) -> None:
    store, artifact = worn
    monkeypatch.delitem(KINDS, "wear")
    assert [header.kind for header in store.headers()] == ["pretrain", "embed-means", "compose"]
    assert [path.name for path in store.strangers()] == ["wear-v1.h5"]
    with pytest.raises(StoreError, match="not an artifact id"):
        ArtifactId.parse(str(artifact.id))
    with pytest.raises(StoreError, match="unknown kind, 'wear'") as caught:
        kind_spec("wear")
    assert caught.value.hint == f"this skill knows {', '.join(STAGES)}"


def test_every_kind_has_a_table_and_with_episodes_a_figure_and_a_recording() -> None:
    assert all(kind in TABLES for kind in STAGES)
    for registry in (SCENES, FIGURES, LAYOUTS):
        assert all(kind in registry for kind, spec in KINDS.items() if spec.holds("trajectories"))


def test_an_unknown_kind_is_an_error_that_lists_what_is_known() -> None:
    registry: ByKind[int] = ByKind("number")
    with pytest.raises(StoreError, match="there is no number of compose") as caught:
        registry.of("compose")
    registry.register(COMPOSE, EMBED_MEANS)(3)
    assert registry.of("compose") == 3 and "pretrain" not in registry
    with pytest.raises(StoreError, match="of pretrain") as caught:
        registry.of("pretrain")
    assert "compose, embed-means" in caught.value.hint


def test_results_of_another_kind_are_refused(store: Store, make: Make) -> None:
    artifact = store.write(make("embed-means"))
    assert EMBED_MEANS.results_of(artifact).halfway[0].from_ == "1"
    with pytest.raises(StoreError, match="is of kind embed-means, expected compose"):
        COMPOSE.results_of(artifact)


# --- records ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Part(Record):
    from_: str
    ratio: float | None
    more: dict[str, Any] = rest()


@dataclass(frozen=True, kw_only=True)
class Whole(Record):
    parts: tuple[Part, ...]
    end: tuple[float, float]
    counts: int = optional(3)
    angle: float | None = optional(None)
    robot: Part | None = optional(None, null=True)


def test_a_record_is_written_and_read_as_the_same() -> None:
    part = Part(from_="1", ratio=None, more={"note": [1, 2]})
    for whole in (
        Whole(parts=(), end=(0.0, 1.0)),
        Whole(parts=(part, part), end=(0.0, 1.0), counts=0, angle=2.5, robot=part),
    ):
        assert Whole.read(json.loads(json.dumps(whole.json()))) == whole
    assert part.json() == {"from": "1", "ratio": None, "note": [1, 2]}


def test_none_is_null_where_null_may_stand_and_left_out_elsewhere() -> None:
    assert Whole(parts=(), end=(0.0, 1.0)).json() == {"parts": [], "end": [0.0, 1.0], "counts": 3, "robot": None}


def test_what_older_artifacts_leave_out_is_read_as_what_it_means() -> None:
    found = Whole.read({"parts": [], "end": [0.0, 1.0], "of_a_later_skill": 1})
    assert (found.counts, found.angle, found.robot) == (3, None, None)


@pytest.mark.parametrize("kind", CHAIN)
def test_what_the_stages_write_is_read_and_written_as_the_same(chain: Path, kind: str) -> None:
    artifact = Store(chain).read(ArtifactId("tiny", kind, 1))
    spec = kind_spec(kind)
    assert spec.results_of(artifact).json() == artifact.results
    assert spec.measured_of(artifact).json() == artifact.measured
    assert not list(complaints(kind, artifact.results, artifact.measured))


def said(written: Any, read: Any) -> bool:
    """Whether everything that an artifact says, as far as the types know it, is what was read of it."""
    if isinstance(written, dict):
        return isinstance(read, dict) and all(said(item, read[key]) for key, item in written.items() if key in read)
    if isinstance(written, list):
        return len(written) == len(read) and all(map(said, written, read))
    return bool(written == read)


def test_every_shipped_artifact_is_read_through_its_types() -> None:
    store = Store(Path(__file__).parents[2] / "artifacts")
    shipped = [one for one in store.ids() if one.name.startswith("reference-")]
    assert len(shipped) > 10
    for one in shipped:
        artifact = store.read(one)
        assert said(artifact.results, kind_spec(one.stage).results_of(artifact).json()), one
        assert said(artifact.measured, kind_spec(one.stage).measured_of(artifact).json()), one
        table_of(artifact)
