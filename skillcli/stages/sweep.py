"""A sweep: run every cell, each by the ordinary stages, and write one artifact that lists them."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from skillcli.errors import Interrupted, UsageError
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, SWEEP, TRANSFER_EVAL
from skillcli.kinds import sweep as kind
from skillcli.kinds.sweep import MAX_FAILURES, SweepFailure, SweepMeasured, SweepResults, SweepSetting, sha_words
from skillcli.progress import OnProgress
from skillcli.recipe import Recipe, load_recipe, resolve
from skillcli.stopping import stoppable
from skillcli.store import Artifact, Draft, Store, content_hash
from skillcli.store.ids import NAME_LENGTH
from skillcli.sweeps.axes import MAX_CELLS, Setting
from skillcli.sweeps.cell import DONE, FAILED, PRUNED, STOPPED, Beat, Cell, Outcome, cell_name, setting_label
from skillcli.sweeps.run import Backend, Run, run_locally

THROUGH = (PRETRAIN.name, EMBED_MEANS.name, COMPOSE.name, TRANSFER_EVAL.name)
"""Stages that a cell may end with."""

_STATES = {FAILED: kind.FAILED, DONE: kind.DONE, PRUNED: kind.PRUNED}


@dataclass(frozen=True)
class SweepPlan:
    """Which cells there are, by setting and within it by seed.

    Args:
        recipe: by name or path, as typed.
        settings: combinations of values.
        seeds: of each.
        name: first part of all ids.
        through: the last stage of every cell.

    Raises:
        UsageError: a recipe is invalid, there are too many cells, or the name is too long for those of its cells.
    """

    recipe: str
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    name: str
    through: str = PRETRAIN.name

    def __post_init__(self) -> None:
        """Refuse what would fail in every cell."""
        if self.through not in THROUGH:
            raise UsageError(f"--through {self.through!r}: expected one of {', '.join(THROUGH)}", "pretrain is the shortest")
        if len(self) > MAX_CELLS:
            raise UsageError(f"{len(self):,} cells, at most {MAX_CELLS:,}", "give fewer seeds or settings")
        longest = max(len(cell_name("", self.varied(index), max(self.seeds))) for index in range(len(self.settings)))
        if len(self.name) + 1 + longest > NAME_LENGTH:
            raise UsageError(f"--name {self.name!r} is too long for the names of the cells", "give --name a shorter one")
        for setting in self.settings:
            self.resolved(setting)

    def varied(self, index: int) -> Setting:
        """Return what distinguishes a setting from the others: the keys that have several values."""
        return tuple((key, value) for key, value in self.settings[index] if key in self._varied_keys)

    @cached_property
    def _varied_keys(self) -> set[str]:
        first, *others = self.settings
        return {key for other in others for (key, value), (_, base) in zip(other, first, strict=True) if value != base}

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.settings) * len(self.seeds)

    def resolved(self, setting: Setting) -> Recipe:
        """Return the recipe of a setting."""
        return load_recipe(self.recipe, [f"{key}={value}" for key, value in setting])

    def cells(self) -> Iterator[Cell]:
        """Make the cells, one after the other."""
        for index, setting in enumerate(self.settings):
            recipe = self.resolved(setting).model_dump(mode="json")
            for turn in range(len(self.seeds)):
                yield self.cell(index, turn, recipe)

    def cell(self, setting: int, turn: int, recipe: dict[str, object]) -> Cell:
        """Make the cell of a setting and of a seed, both by their place."""
        seed, values = self.seeds[turn], self.settings[setting]
        name = cell_name(self.name, self.varied(setting), seed)
        sets = [word for key, value in values for word in ("--set", f"{key}={value}")]
        what = PRETRAIN.name if self.through == PRETRAIN.name else "run"
        by_hand = shlex.join(["skill", what, self.recipe, "--seed", str(seed), *sets, "--name", name])
        return Cell(setting * len(self.seeds) + turn, setting, seed, name, self.through, recipe, by_hand)

    def place(self, index: int) -> tuple[int, int]:
        """Return setting and seed of a cell."""
        setting, turn = divmod(index, len(self.seeds))
        return setting, self.seeds[turn]


@dataclass
class Tally:
    """What became of the cells so far; a few numbers for each."""

    plan: SweepPlan
    outcomes: dict[int, Outcome] = field(default_factory=dict)

    def add(self, outcome: Outcome) -> None:
        """Take an outcome."""
        if outcome.state != STOPPED:
            self.outcomes[outcome.index] = outcome

    def count(self, state: str) -> int:
        """Return how many cells are in a state."""
        return sum(outcome.state == state for outcome in self.outcomes.values())


def sweep(
    store: Store,
    plan: SweepPlan,
    command: str,
    jobs: int,
    backend: Backend = run_locally,
    where: str = "local",
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
        on_outcome: called with the outcome of every cell.
        on_beat: called while cells run.

    Returns:
        The artifact, which is the one of before if nothing differs, and the outcomes in order.

    Raises:
        Interrupted: Ctrl-C; finished cells and the state of running ones were kept.
        StoreError: the store refuses.
    """
    store.check_writable(plan.name)
    began, tally = time.perf_counter(), Tally(plan)

    def concluded(outcome: Outcome) -> None:
        tally.add(outcome)
        on_outcome(outcome)

    def beating(beat: Beat) -> bool:
        on_beat(beat)
        return True

    with stoppable() as stop:
        run = Run(run_cell, store.root, jobs, concluded, beating, lambda: stop.requested)
        backend(run, plan.cells())
        if len(tally.outcomes) < len(plan):
            raise Interrupted(
                f"stopped: {len(tally.outcomes)} of {len(plan)} cells are finished, running ones were saved",
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
