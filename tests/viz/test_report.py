"""The report: a page that stands alone, whose every number leads to the artifact it was read from."""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import made, skill

from skillcli.errors import SkillError, UnknownArtifact
from skillcli.recipe import load_recipe, recipe_names, resolve
from skillcli.store import ArtifactId, Draft, Store
from skillcli.viz import figure_style
from skillcli.viz.report import comparison, figures
from skillcli.viz.report.content import Number, Row
from skillcli.viz.report.selection import Exhibit, select
from skillcli.viz.report.write import as_toml, report

pytestmark = pytest.mark.slow

REFERENCE = Path(__file__).parents[2] / "artifacts"


class Reader(HTMLParser):
    """Tags, anchors and addresses of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "src"):
                self.addresses.append(value or "")


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """Figures as coarse as can be: nobody looks at these."""
    before, figure_style.DPI = figure_style.DPI, 40
    yield
    figure_style.DPI = before


@pytest.fixture(scope="module")
def written(chain: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """What the command says of the tiny chain, and the page."""
    page = tmp_path_factory.mktemp("report") / "tiny.html"
    return made("--store", chain, "report", "-o", page), page


def test_the_page_stands_alone(written: tuple[Any, Path]) -> None:
    text = written[1].read_text()
    read = Reader(text)
    assert "http://" not in text and "https://" not in text
    assert {"link", "iframe", "object", "embed", "base", "form"}.isdisjoint(read.tags)
    assert all(address.startswith(("#", "data:image/svg+xml;base64,")) for address in read.addresses)
    assert "url(" not in text and "@import" not in text
    assert 'name="viewport"' in text and "@media print" in text


def test_every_link_has_its_place_once(written: tuple[Any, Path]) -> None:
    read = Reader(written[1].read_text())
    assert len(set(read.ids)) == len(read.ids)
    targets = {address[1:] for address in read.addresses if address.startswith("#")}
    assert targets <= set(read.ids) and len(targets) > 8


def test_every_number_is_what_stands_at_its_key(chain: Path) -> None:
    material = select(Store(chain), [])
    by_id = {one.id: one for one in material.exhibits}
    rows = [row for table in comparison.tables(material) for row in table.rows if row.here]
    assert len(rows) > 10
    for row in rows:
        assert row.here is not None
        found = at(by_id[row.here.artifact], row.here.key)
        if isinstance(found, float | int):
            shown = float(re.sub(r"[^0-9.eE+-]", "", row.here.text.split()[0].rstrip("°%")))
            scale = 100 if "cm" in row.here.text or "%" in row.here.text else 1
            assert shown == pytest.approx(scale * found, rel=0.05, abs=0.06), row
        else:
            assert found, row


def at(one: Exhibit, key: str) -> Any:
    """What stands at a key such as results.skills[0].name."""
    steps = [int(step) if step.isdigit() else step for step in re.findall(r"[\w-]+", key)]
    return one.value(*steps)


def test_every_number_cell_names_an_artifact_on_the_page(written: tuple[Any, Path]) -> None:
    text = written[1].read_text()
    cells = re.findall(r'<td class="here".*?</td>.*?<td class="from">(.*?)</td>', text, re.DOTALL)
    anchors = [re.search(r'href="#(artifact-[\w-]+)"', cell) for cell in cells]
    assert len(cells) > 10 and all(anchors)
    assert {found[1] for found in anchors if found} <= set(Reader(text).ids)
    assert all("<code>results." in cell or "<code>measured." in cell for cell in cells)


def test_json_names_the_figures_and_where_they_are(written: tuple[Any, Path], chain: Path) -> None:
    said, page = written
    assert said["html"] == str(page)
    assert {figure["paper_figure"] for figure in said["figures"]} >= {"4", "5", ""}
    for figure in said["figures"]:
        assert Path(figure["file"]).read_bytes().startswith(b"%PDF") and Path(figure["png"]).is_file()
        assert Path(figure["file"]).parent == page.parent / "tiny_figures"
        assert set(figure["artifacts"]) <= {str(one) for one in Store(chain).ids()}
    drawn, named = (
        {figure["title"] for figure in said["figures"]},
        {lost["figure"].split(" (")[0] for lost in said["not_drawn"]},
    )
    assert drawn | named == {subject.title for subject in figures.SUBJECTS} and not drawn & named


def test_the_same_store_gives_the_same_bytes(written: tuple[Any, Path], chain: Path, tmp_path: Path) -> None:
    made("--store", chain, "report", "-o", tmp_path / "tiny.html")
    assert (tmp_path / "tiny.html").read_bytes() == written[1].read_bytes()
    for file in (tmp_path / "tiny_figures").iterdir():
        assert file.read_bytes() == (written[1].parent / "tiny_figures" / file.name).read_bytes(), file.name


def test_hostile_text_stays_text(chain: Path, tmp_path: Path) -> None:
    evil = '"><script>alert(1)</script>$\\frac{$ https://example.org/x'
    shutil.copytree(chain, tmp_path / "store")
    store = Store(tmp_path / "store")
    good = store.read(ArtifactId("tiny", "pretrain", 1))
    recipe = {**good.recipe, "description": evil}
    store.write(draft(good, name="evil", recipe=recipe, command=f"skill {evil}"))
    page = tmp_path / "evil.html"
    report(store, [ArtifactId("evil", "pretrain", 1)], page)
    text = page.read_text()
    assert "alert(1)" in text, "it is shown, as text"
    assert Reader(text).tags.count("script") == 1 and "<script>alert" not in text
    assert "http://" not in text and "https://" not in text


def draft(good: Any, **changed: Any) -> Draft:
    kept = {name: getattr(good, name) for name in ("kind", "seed", "command", "recipe", "arrays", "results", "measured")}
    return Draft(**{**kept, "name": good.id.name, "model_sha256": good.model_sha256, **changed})


def test_damaged_and_foreign_artifacts_are_said_and_left_out(chain: Path, tmp_path: Path) -> None:
    shutil.copytree(chain, tmp_path / "store")
    store = Store(tmp_path / "store")
    damaged = store.path(ArtifactId("tiny", "transfer-eval", 1))
    content = bytearray(damaged.read_bytes())
    content[-100] ^= 1
    damaged.write_bytes(content)
    good = store.read(ArtifactId("tiny", "compose", 1))
    other = resolve(good.recipe, ["task.action_limit=0.03"]).model_dump(mode="json")
    store.write(draft(good, name="foreign", recipe=other, parents=[parent.id for parent in good.parents]))
    done = skill("--store", store.root, "report", "-o", tmp_path / "page.html")
    assert done.code == 0, done.err
    told = " ".join(done.err.split())
    assert "not used: tiny/transfer-eval-v1" in told and "not used: foreign/compose-v1" in told
    warned = (tmp_path / "page.html").read_text().split('id="skipped"')[1].split("</div>")[0]
    assert "tiny/transfer-eval-v1" in warned and "foreign/compose-v1" in warned


def test_one_that_was_asked_for_must_be_whole(chain: Path, tmp_path: Path) -> None:
    shutil.copytree(chain, tmp_path / "store")
    store = Store(tmp_path / "store")
    one = ArtifactId("tiny", "compose", 1)
    store.path(one).write_bytes(store.path(one).read_bytes()[:-10])
    with pytest.raises(SkillError, match="tiny/compose-v1"):
        report(store, [one], tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists() and not (tmp_path / "page_figures").exists()


def test_an_empty_store_says_what_to_do(tmp_path: Path) -> None:
    done = skill("--store", tmp_path / "none", "report", "-o", tmp_path / "page.html")
    assert done.code == 1 and "nothing to report" in done.err and " demo`" in done.err
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_takes_no_page_is_refused_before_the_work(chain: Path, tmp_path: Path) -> None:
    with pytest.raises(SkillError, match="there is no folder"):
        report(Store(chain), [], tmp_path / "nowhere" / "page.html")
    with pytest.raises(SkillError, match="it is a folder"):
        report(Store(chain), [], tmp_path)
    with pytest.raises(UnknownArtifact):
        Store(chain).resolve("nobody/pretrain")


def test_asked_for_one_it_takes_what_that_was_made_from_and_no_more(chain: Path) -> None:
    material = select(Store(chain), [ArtifactId("tiny", "compose", 1)])
    assert [one.id for one in material.exhibits] == ["tiny/compose-v1", "tiny/embed-means-v1", "tiny/pretrain-v1"]


def test_figures_of_an_earlier_report_do_not_stay(chain: Path, tmp_path: Path) -> None:
    folder = tmp_path / "page_figures"
    folder.mkdir()
    (folder / "figure-09-searched.pdf").write_text("old")
    (folder / "mine.pdf").write_text("mine")
    report(Store(chain), [ArtifactId("tiny", "pretrain", 1)], tmp_path / "page.html")
    assert not (folder / "figure-09-searched.pdf").exists() and (folder / "mine.pdf").read_text() == "mine"


@pytest.mark.parametrize("name", recipe_names())
def test_a_recipe_as_toml_is_the_same_recipe(name: str) -> None:
    recipe = load_recipe(name).model_dump(mode="json")
    read = tomllib.loads(as_toml(recipe))
    assert read == without_none(recipe)


def without_none(item: Any) -> Any:
    return {key: without_none(value) for key, value in item.items() if value is not None} if isinstance(item, dict) else item


def test_runs_of_an_arm_go_on_with_their_last_value() -> None:
    def run(returns: list[float]) -> Any:
        curves = {"greedy_return": np.array(returns), "env_steps": 1000.0 * np.arange(1, len(returns) + 1)}
        return type("Run", (), {"scene": type("S", (), {"curves": curves})})

    steps, returns = figures._padded([run([1.0, 2.0]), run([3.0, 4.0, 5.0])])
    assert steps.tolist() == [1, 2, 3] and returns.tolist() == [[1, 2, 2], [3, 4, 5]]


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The reference artifacts alone: a user's own, `make demo`'s say, may lie beside them."""
    folder = tmp_path_factory.mktemp("shipped")
    for found in REFERENCE.glob("reference-*"):
        shutil.copytree(found, folder / found.name)
    return Store(folder)


@pytest.fixture(scope="module")
def reference(shipped: Store) -> list[Row]:
    """The rows of the reference artifacts."""
    return [row for table in comparison.tables(select(shipped, [])) for row in table.rows]


def test_what_falls_short_is_said(reference: list[Row]) -> None:
    metrics = [row for row in reference if row.what.startswith("latent against goal distances")]
    assert len(metrics) == 2, "the Sawyer and the UR5e"
    for metric in metrics:
        assert metric.here is not None and metric.here.key == "results.latent_goal_correlation"
        assert metric.paper == "0.92" and metric.verdict == ("better" if float(metric.here.text) > 0.92 else "falls short")
    one = type("One", (), {"id": "a/pretrain-v1", "value": lambda *path: 0.6})
    row = comparison._lower("what", "0.5", 0.5, one, "{:.1f}", "efficiency")  # type: ignore[arg-type]
    assert row == Row("what", "0.5", Number("0.6", "a/pretrain-v1", "results.efficiency"), "falls short")
    assert comparison._lower("what", "0.7", 0.7, one, "{:.1f}", "efficiency").verdict == "better"  # type: ignore[arg-type]


def test_a_real_robot_is_never_simply_beaten(reference: list[Row]) -> None:
    assert not [row for row in reference if "(real)" in row.paper and row.verdict == "better"]


def test_paper_goals_without_a_counterpart_say_how_to_get_one() -> None:
    none = type("Material", (), {"find": lambda *_, **__: []})()
    rows = [row for table in comparison.tables(none) for row in table.rows]
    assert len(rows) == 7 and all(row.here is None and row.todo.startswith("skill compose ID --") for row in rows)


def test_the_reference_artifacts_hold_every_number_of_the_paper(reference: list[Row], shipped: Store) -> None:
    assert [row.what for row in reference if row.here is None] == []
    assert figures.make_figures(select(shipped, []))[1] == []


def test_what_artifacts_do_not_hold_is_said_with_a_command_that_gives_it(shipped: Store) -> None:
    few = select(shipped, [ArtifactId("reference-reach", "embed-means", 1), ArtifactId("reference-push", "embed-means", 1)])
    todo = {row.todo for table in comparison.tables(few) for row in table.rows if row.todo}
    assert "skill compose reference-reach/embed-means --method ddpg --goal=0.5,0,0.15" in todo
    assert "skill compose reference-push/embed-means --goal=-0.2,0.1" in todo
    _, missing = figures.make_figures(few)
    (arms,) = [each for each in missing if each.what.startswith("Composer:")]
    assert "--latents continuous` and `skill compose reference-reach/embed-means" in arms.reason


def test_the_reference_store_gives_the_papers_figures(shipped: Store, tmp_path: Path) -> None:
    material = select(shipped, [])
    plans = {subject.slug: subject.plan(material) for subject in figures.SUBJECTS}
    drawn = {slug for slug, plan in plans.items() if plan}
    assert {"figure-02-point", "figure-04-reach", "figure-05-composed", "figure-07-push", "figure-08-means"} <= drawn
    assert {"figure-09-searched", "figure-10-arms"} <= drawn and len(drawn) >= 9
    for plan in plans.values():
        assert plan is None or re.search(r"\d", plan.caption), "n, tolerance or interval is stated"
