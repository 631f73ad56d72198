"""A search for settings: trials, a journal that goes on, stops by the learning curve. Nothing is trained."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import SkillError, UsageError
from skillcli.sweeps.axes import Axis, axis
from skillcli.sweeps.cell import Beat, Cell, Outcome
from skillcli.sweeps.plan import SweepPlan
from skillcli.sweeps.search import Search

pytestmark = pytest.mark.slow  # studies of optuna

pytest.importorskip("optuna")

AXES = [axis("training.iterations=1..1000"), axis("task.horizon=16,32")]


def search(root: Path, trials: int, axes: list[Axis] | None = None) -> Search:
    told = frozenset({"training.iterations", "task.horizon"})
    return Search(SweepPlan("smoke", ((),), (0, 1), "opt", told=told), axes or AXES, trials, "success_rate", True, root)


def run(found: Search, stop_after: int = 10_000) -> list[Cell]:
    """Every cell succeeds the more often the more iterations it has."""
    ran = []
    for cell in found.cells():
        if len(ran) == stop_after:
            break
        ran.append(cell)
        value = cell.recipe["training"]["iterations"] / 1000
        found.concluded(Outcome(cell.index, "done", (), "", {"success_rate": value}))
    return ran


def test_the_best_setting_is_found_among_those_that_were_tried(tmp_path: Path) -> None:
    found = search(tmp_path, 12)
    cells = run(found)
    assert (
        len(cells) == 24 and [cell.seed for cell in cells] == [0, 1] * 12 and [cell.index for cell in cells] == list(range(24))
    )
    tried = [cell.recipe["training"]["iterations"] for cell in cells]
    best = found.best()
    assert best is not None and best[1] == max(tried) / 1000 and best[0][0] == ("training.iterations", str(max(tried)))
    assert found.plan.settings[3] == tuple(found._settings[3]) and len(found.plan) == 24
    assert sum(tried[12:]) > sum(tried[:12]), "it learns"


def test_an_interrupted_search_goes_on_with_the_same_settings(tmp_path: Path) -> None:
    first = search(tmp_path, 4)
    before = [cell.recipe for cell in run(first, stop_after=5)]
    again = search(tmp_path, 4)
    cells = run(again)
    assert [cell.recipe for cell in cells][:5] == before and len(cells) == 8
    assert len(again._numbers) == len(again.plan.settings) == 4 and again.best() is not None
    with pytest.raises(SkillError, match="another search"):
        search(tmp_path, 2, [axis("training.simulations=16,32")])


def test_a_trial_below_the_others_is_stopped_and_its_other_seeds_never_run(tmp_path: Path) -> None:
    found, pruned = search(tmp_path, 8), []
    for cell in found.cells():
        trial = cell.index // 2
        good = trial < 6
        going = [found.beating(Beat(cell.index, "pretrain", part / 10, 0.9 if good else 0.0)) for part in range(10)]
        if all(going):
            found.concluded(Outcome(cell.index, "done", (), "", {"success_rate": 0.9}))
        else:
            pruned.append(cell.index)
            found.concluded(Outcome(cell.index, "pruned"))
    assert pruned == [12, 14] and [outcome.index for outcome in found.skipped] == [13, 15]
    assert {outcome.state for outcome in found.skipped} == {"pruned"}


def test_settings_are_not_run_twice_and_a_search_of_few_ends(tmp_path: Path) -> None:
    found = search(tmp_path, 10, [axis("task.horizon=16,32")])
    assert len(run(found)) == 4 and len(found.plan.settings) == 2


def test_there_must_be_something_to_search(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="searches values"):
        Search(SweepPlan("smoke", ((),), (0,), "opt"), [], 2, "success_rate", True, tmp_path)
