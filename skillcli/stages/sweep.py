"""A sweep: run every cell, each by the ordinary stages, and write one artifact that lists them."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from skillcli.errors import Interrupted
from skillcli.kinds import SWEEP
from skillcli.kinds import sweep as kind
from skillcli.kinds.sweep import MAX_FAILURES, SweepFailure, SweepMeasured, SweepResults, SweepSetting, sha_words
from skillcli.progress import OnProgress
from skillcli.recipe import load_recipe, resolve
from skillcli.stopping import stoppable
from skillcli.store import Artifact, Draft, Store, content_hash
from skillcli.sweeps.alone import alone
from skillcli.sweeps.cell import DONE, FAILED, PRUNED, Beat, Cell, Outcome, setting_label
from skillcli.sweeps.plan import SweepPlan, Tally
from skillcli.sweeps.run import Backend, Run, run_locally
from skillcli.sweeps.search import Search

_STATES = {FAILED: kind.FAILED, DONE: kind.DONE, PRUNED: kind.PRUNED}


def sweep(
    store: Store,
    plan: SweepPlan,
    command: str,
    jobs: int,
    backend: Backend = run_locally,
    where: str = "local",
    search: Search | None = None,
    on_outcome: Callable[[Outcome], None] = lambda _: None,
    on_beat: Callable[[Beat], None] = lambda _: None,
) -> tuple[Artifact, list[Outcome]]:
    """Run all cells and write a sweep artifact; finished cells with unchanged inputs are used again.

    Args:
        store: to read from and write to.
        plan: which cells.
        command: as typed, for the record.
        jobs: how many cells at a time.
        backend: runs them.
        where: name of the backend, for the record.
        search: proposes the settings, instead of those of the plan.
        on_outcome: called with the outcome of every cell.
        on_beat: called while cells run.

    Returns:
        The artifact, which is the one of before if nothing differs, and the outcomes in order.

    Raises:
        Interrupted: Ctrl-C; finished cells and the state of running ones were kept.
        StoreError: the store refuses.
    """
    store.check_writable(plan.name)
    began, tally = time.perf_counter(), Tally()

    def concluded(outcome: Outcome) -> None:
        tally.add(outcome)
        if search is not None:
            search.concluded(outcome)
        on_outcome(outcome)

    def beating(beat: Beat) -> bool:
        on_beat(beat)
        return search is None or search.beating(beat)

    with stoppable() as stop:
        run = Run(run_cell, store.root, jobs, concluded, beating, lambda: stop.requested)
        backend(run, plan.cells() if search is None else search.cells())
        if search is not None and not stop.requested:
            plan = search.plan
            for outcome in search.skipped:
                tally.add(outcome)
        if (search is not None and stop.requested) or len(tally.outcomes) < len(plan):
            total = len(plan if search is None else search)
            raise Interrupted(
                f"stopped: {len(tally.outcomes)} of {total} cells are finished, running ones were saved",
                "the same command goes on from here",
            )
    draft = draft_of(plan, tally, command, time.perf_counter() - began, jobs, where)
    return _kept(store, draft), [tally.outcomes[index] for index in range(len(plan))]


def run_cell(root: str, cell: Cell, threads: int, on_progress: OnProgress) -> Outcome:
    """Run one cell by the ordinary stages, in whatever process.

    Raises:
        SkillError: a stage fails.
        Interrupted: it was asked to stop; what can be resumed was saved.
    """
    from skillcli.evaluation.run_metrics import metrics_of  # slow to import, and the sweep's own process needs none of it
    from skillcli.stages.chain import run_chain

    store = Store(Path(root))
    links = []
    recipe = resolve(cell.recipe, by_hand=True)
    chain = run_chain(store, recipe, cell.seed, cell.name, cell.command, on_progress, threads, _elsewhere(root))
    with alone(store.root / cell.name):
        for link in chain:
            links.append(link)
            if link.artifact.kind == cell.through:
                break
    return Outcome(
        cell.index,
        DONE,
        tuple(str(link.artifact.id) for link in links),
        links[-1].artifact.content_sha256,
        metrics_of(link.artifact for link in links),
        all(link.reused for link in links),
    )


@cache
def _elsewhere(root: str):  # type: ignore[no-untyped-def]  # the type stands in a module that is slow to import
    """Read once what there was when this process began: what comes later has the names of the cells."""
    from skillcli.evaluation.reuse import by_inputs

    return by_inputs(Store(Path(root)))


def draft_of(plan: SweepPlan, tally: Tally, command: str, seconds: float, jobs: int, where: str) -> Draft:
    """Collect what became of the cells; which ids and machines it was stands in nothing that is hashed."""
    outcomes = [tally.outcomes[index] for index in range(len(plan))]
    failed = [outcome for outcome in outcomes if outcome.state == FAILED]
    names = sorted({name for outcome in outcomes for name in outcome.metrics})
    places = np.array([plan.place(outcome.index) for outcome in outcomes], dtype=np.int64)
    results = SweepResults(
        through=plan.through,
        settings=tuple(
            SweepSetting(label=setting_label(plan.varied(index)), values=dict(setting))
            for index, setting in enumerate(plan.settings)
        ),
        cells=len(outcomes),
        failed=len(failed),
        pruned=tally.count(PRUNED),
        failures=tuple(_failure(plan, outcome) for outcome in failed[:MAX_FAILURES]),
    )
    return Draft(
        kind=SWEEP.name,
        name=plan.name,
        seed=plan.seeds[0],
        command=command,
        recipe=load_recipe(plan.recipe).model_dump(mode="json"),
        arrays={
            "cells/setting": places[:, 0],
            "cells/seed": places[:, 1],
            "cells/state": np.array([_STATES[outcome.state] for outcome in outcomes]),
            "cells/content": np.array([sha_words(outcome.content_sha256) for outcome in outcomes]),
            **{f"metrics/{name}": np.array([each.metrics.get(name, np.nan) for each in outcomes]) for name in names},
        },
        results=results.json(),
        measured=SweepMeasured(
            wall_seconds=seconds, reused=sum(outcome.reused for outcome in outcomes), jobs=jobs, where=where
        ).json(),
    )


def _failure(plan: SweepPlan, outcome: Outcome) -> SweepFailure:
    setting, seed = plan.place(outcome.index)
    return SweepFailure(setting=setting, seed=seed, message=outcome.message[:300])


def _kept(store: Store, draft: Draft) -> Artifact:
    """Write a sweep, unless the newest one of its name has the same content."""
    from skillcli.store.codec import check_draft, finish

    before = store.newest(draft.name, draft.kind)
    if before is not None:
        same = finish(check_draft(draft), before.version, ())
        found = store.read(before)
        if content_hash(found) == found.content_sha256 == same.content_sha256:
            return found
    return store.write(draft)
