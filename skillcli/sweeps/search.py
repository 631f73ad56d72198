"""Search for settings with Optuna: every trial is a setting that runs with every seed, and its value their mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from skillcli.errors import SkillError, UsageError
from skillcli.store.atomic import make_folder
from skillcli.sweeps.axes import Axis, Choice, Setting
from skillcli.sweeps.cell import DONE, PRUNED, STOPPED, Beat, Cell, Outcome, cell_label
from skillcli.sweeps.plan import SweepPlan

JOURNAL = ".optuna-journal"
"""The file below the sweep's name that keeps the trials: the same command goes on from it."""
PARTS = 10  # of a training, at which it is compared with those of other trials
ATTEMPTS = 50  # to find a setting that was not tried yet
AGAIN = "tried before"
"""Mark in the journal of a setting that was proposed twice, and not run again."""
FIRST_TRIALS = 5  # that are never stopped early


@dataclass
class Search:
    """Proposes settings, and learns from what becomes of them.

    Args:
        base: recipe, seeds, name and last stage; its settings are not looked at.
        axes: what may vary.
        trials: how many settings to try, those of an earlier run of the same search included.
        metric: to optimise.
        higher: whether more of it is better.
        root: of the store.
    """

    base: SweepPlan
    axes: Sequence[Axis]
    trials: int
    metric: str
    higher: bool
    root: Path
    _settings: list[Setting] = field(default_factory=list)
    _outcomes: dict[int, dict[int, Outcome]] = field(default_factory=dict)  # by trial and turn
    _pruned: set[int] = field(default_factory=set)
    _reported: dict[int, int] = field(default_factory=dict)  # the last part of each trial
    _skipped: list[Outcome] = field(default_factory=list)
    _numbers: list[int] = field(default_factory=list)  # of each trial in the journal
    _open: set[int] = field(default_factory=set)  # trials whose value is not yet known

    def __post_init__(self) -> None:
        """Open the journal.

        Raises:
            UsageError: there is nothing to search.
            SkillError: Optuna is not installed, or the journal is of another search.
        """
        if not self.axes:
            raise UsageError("--optuna searches values, and there are none", "give --set KEY=A,B,C or --set KEY=LOW..HIGH")
        try:
            import optuna
        except ImportError as error:
            raise SkillError("--optuna: the package is not installed", "pip install 'skillcli[optuna]'") from error
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        folder = self.root / self.base.name
        make_folder(folder)
        self._state = optuna.trial.TrialState
        self._study = optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(folder / JOURNAL))),
            sampler=optuna.samplers.TPESampler(seed=0, constant_liar=True),
            pruner=optuna.pruners.MedianPruner(n_startup_trials=FIRST_TRIALS, n_warmup_steps=1),
            study_name=f"{self.base.recipe} {self.metric}",
            direction="maximize" if self.higher else "minimize",
            load_if_exists=True,
        )
        if self._study.trials and any(one.params.keys() - {axis.key for axis in self.axes} for one in self._study.trials):
            raise SkillError(f"{folder / JOURNAL} is of another search", "give --name another name, or remove that file")

    @property
    def plan(self) -> SweepPlan:
        """Return the plan of what was tried."""
        return replace(self.base, settings=tuple(self._settings))

    @property
    def skipped(self) -> list[Outcome]:
        """Return the outcomes of cells that never ran, because their trial was stopped before."""
        return self._skipped

    def __len__(self) -> int:
        """Return how many cells there are at most."""
        return self.trials * len(self.base.seeds)

    def label(self, index: int) -> str:
        """Return a cell as people read it."""
        trial, turn = divmod(index, len(self.base.seeds))
        return cell_label(self._settings[trial], self.base.seeds[turn])

    def cells(self) -> Iterator[Cell]:
        """Make the cells, each setting when its first cell is asked for; none where nothing new is left to try."""
        for trial in range(self.trials):
            if (setting := self._propose(trial)) is None:
                return
            self._settings.append(setting)
            plan = replace(self.base, settings=(setting,))
            recipe = plan.resolved(setting).model_dump(mode="json")
            for turn in range(len(self.base.seeds)):
                index = trial * len(self.base.seeds) + turn
                if trial in self._pruned:
                    self._skipped.append(Outcome(index, PRUNED))
                else:
                    yield replace(plan.cell(0, turn, recipe), index=index, setting=trial)

    def _propose(self, trial: int) -> Setting | None:
        """Return the setting of a trial: of an earlier run of this search, or a new one; None if there is none."""
        keys = {axis.key for axis in self.axes}
        known = [one for one in self._study.trials if AGAIN not in one.user_attrs and one.params.keys() == keys]
        if trial < len(known):
            before = known[trial]
            self._numbers.append(before.number)
            if before.state == self._state.RUNNING:
                self._open.add(trial)
            elif before.state == self._state.PRUNED:
                self._pruned.add(trial)
            return tuple((axis.key, _text(before.params[axis.key])) for axis in self.axes)
        for _ in range(ATTEMPTS):
            asked = self._study.ask()
            setting = tuple((axis.key, _text(self._suggest(asked, axis))) for axis in self.axes)
            if setting not in self._settings:
                self._numbers.append(asked.number)
                self._open.add(trial)
                return setting
            asked.set_user_attr(AGAIN, True)
            self._study.tell(asked, state=self._state.FAIL)
        return None

    @staticmethod
    def _suggest(trial: Any, axis: Axis) -> Any:
        if isinstance(axis, Choice):
            return trial.suggest_categorical(axis.key, axis.values)
        if axis.whole:
            return trial.suggest_int(axis.key, int(axis.low), int(axis.high), log=axis.log)
        return trial.suggest_float(axis.key, axis.low, axis.high, log=axis.log)

    def beating(self, beat: Beat) -> bool:
        """Compare a learning curve with those of other trials; return whether the cell shall go on."""
        trial, turn = divmod(beat.index, len(self.base.seeds))
        if trial in self._pruned:
            return False
        if trial not in self._open or beat.success is None or not self.higher:
            return True
        part = turn * PARTS + int(beat.share * PARTS)
        if part <= self._reported.get(trial, -1):
            return True
        self._reported[trial] = part
        running = self._trial(trial)
        running.report(beat.success, part)
        if not running.should_prune():
            return True
        self._pruned.add(trial)
        self._open.discard(trial)
        self._study.tell(self._numbers[trial], state=self._state.PRUNED)
        return False

    def _trial(self, trial: int) -> Any:
        from optuna.trial import Trial

        return Trial(self._study, self._study.trials[self._numbers[trial]]._trial_id)

    def concluded(self, outcome: Outcome) -> None:
        """Take an outcome; the last one of a trial gives its value."""
        if outcome.state == STOPPED:
            return
        trial, turn = divmod(outcome.index, len(self.base.seeds))
        found = self._outcomes.setdefault(trial, {})
        found[turn] = outcome
        if trial in self._open and len(found) == len(self.base.seeds):
            values = [each.metrics.get(self.metric, np.nan) for each in found.values() if each.state == DONE]
            self._open.discard(trial)
            number = self._numbers[trial]
            if values and np.isfinite(values).all():
                self._study.tell(number, float(np.mean(values)))
            else:
                self._study.tell(number, state=self._state.FAIL)

    def best(self) -> tuple[Setting, float] | None:
        """Return the best setting and its value; None if no trial was finished."""
        trials = [(setting, self._study.trials[number]) for setting, number in zip(self._settings, self._numbers, strict=True)]
        done = [(setting, float(one.value)) for setting, one in trials if one.state == self._state.COMPLETE]
        return max(done, key=lambda found: found[1] if self.higher else -found[1], default=None)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)
