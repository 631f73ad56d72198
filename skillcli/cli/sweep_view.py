"""How a sweep is shown: a live table while it runs, and its cells afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from skillcli.evaluation.run_metrics import FIRST, last_success
from skillcli.kinds import PRETRAIN, SWEEP
from skillcli.kinds.sweep import DONE, PRUNED
from skillcli.store import Artifact
from skillcli.sweeps import cell as states
from skillcli.sweeps.axes import Setting
from skillcli.sweeps.cell import Beat, Outcome
from skillcli.trajectories import Array

if TYPE_CHECKING:
    from skillcli.sweeps.plan import SweepPlan

ROWS = 12  # of cells that run, or ended last
TOLD_FAILURES = 20
_STYLES = {states.DONE: "green", states.FAILED: "red", states.RUNNING: "cyan", states.PRUNED: "yellow"}


class SweepView:
    """The live table: cells that run, those that ended last, and how long the rest will take."""

    def __init__(self, total: int, label: Callable[[int], str], jobs: int) -> None:
        self._total, self._label, self._jobs = total, label, jobs
        self._began = time.monotonic()
        self._running: dict[int, tuple[Beat, float]] = {}  # with the time of its first sign of life
        self._ended: list[Outcome] = []  # the last few
        self._count = dict.fromkeys((states.DONE, states.FAILED, states.PRUNED), 0)
        self._reused = 0
        self._spent, self._timed = 0.0, 0  # seconds of the cells that ran here
        self._failed: list[str] = []

    @property
    def failures(self) -> list[str]:
        """Return the lines of the first failures."""
        more = self._count[states.FAILED] - len(self._failed)
        return self._failed + ([f"and {more} more failed"] if more > 0 else [])

    def beating(self, beat: Beat) -> None:
        """Take a sign of life."""
        _, since = self._running.get(beat.index, (beat, time.monotonic()))
        self._running[beat.index] = beat, since

    def concluded(self, outcome: Outcome) -> None:
        """Take an outcome."""
        if (running := self._running.pop(outcome.index, None)) and outcome.state == states.DONE:
            self._spent, self._timed = self._spent + time.monotonic() - running[1], self._timed + 1
        if outcome.state not in self._count:
            return
        self._count[outcome.state] += 1
        self._reused += outcome.reused
        self._ended = [*self._ended, outcome][-ROWS:]
        if outcome.state == states.FAILED and len(self._failed) < TOLD_FAILURES:
            self._failed.append(f"failed: {self._label(outcome.index)}: {outcome.message}")

    def render(self) -> RenderableType:
        """Show the table as it stands."""
        table = Table("cell", "state", "success of the stage", "time left", box=None, pad_edge=False)
        room = max(0, ROWS - len(self._running))
        for outcome in self._ended[-room:] if room else ():
            told = "reused" if outcome.reused else outcome.state
            table.add_row(self._label(outcome.index), Text(told, _STYLES[outcome.state]), _success(outcome), "")
        for index, (beat, since) in sorted(self._running.items())[:ROWS]:
            share = f"{beat.stage} {beat.share:.0%}"
            success = "" if beat.success is None else f"{beat.success:.0%}"
            table.add_row(self._label(index), Text(share, _STYLES[states.RUNNING]), success, self._left_of(beat, since))
        return Group(table, self._summary())

    def _summary(self) -> Text:
        ended = sum(self._count.values())
        parts = [f"{ended}/{self._total} cells"]
        parts += [f"{count} {state}" for state, count in self._count.items() if count and state != states.DONE]
        parts += [f"{self._reused} reused"] if self._reused else []
        return Text(" · ".join([*parts, f"{self._left()} left"]), "bold", no_wrap=True)

    def _left(self) -> str:
        """Estimate the time of the whole from the cells that ran here."""
        waiting = self._total - sum(self._count.values())
        if not self._timed:
            return "?"
        return _clock(self._spent / self._timed * waiting / min(self._jobs, max(1, waiting)))

    def _left_of(self, beat: Beat, since: float) -> str:
        spent = time.monotonic() - since
        return _clock(spent * (1 - beat.share) / beat.share) if beat.share > 0 and spent > 1 else "?"


def listed(plan: SweepPlan, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Return every cell for --json."""
    return [
        {
            "seed": seed,
            "settings": _values(plan.settings[setting]),
            "id": outcome.ids[-1] if outcome.ids else None,
            "state": outcome.state,
            "reused": outcome.reused,
            "metrics": dict(outcome.metrics),
            **({"message": outcome.message} if outcome.message else {}),
        }
        for outcome in outcomes
        for setting, seed in [plan.place(outcome.index)]
    ]


def _values(setting: Setting) -> dict[str, Any]:
    from skillcli.recipe import parsed_value

    return {key: parsed_value(key, value) for key, value in setting}


def table(artifact: Artifact, reused: int | None = None) -> Group:
    """Show one row for each setting of a sweep, with the success of the last stage.

    Args:
        artifact: the sweep.
        reused: cells that were there already this time; None for when the artifact was made.
    """
    found, metrics = SWEEP.results_of(artifact), artifact.group("metrics")
    state, setting = artifact.arrays["cells/state"], artifact.arrays["cells/setting"]
    shown = last_success(metrics)
    rows = Table("setting", "cells", "failed", *([_title(name) for name in shown] or ["success"]))
    for index, each in enumerate(found.settings):
        own = setting == index
        done, pruned = int((state[own] == DONE).sum()), int((state[own] == PRUNED).sum())
        means = [_mean(metrics[name][own & (state == DONE)]) for name in shown] or ["–"]
        failed = int(own.sum()) - done - pruned
        rows.add_row(each.label or found.through, f"{done}/{int(own.sum())}", str(failed or ""), *means)
    already = SWEEP.measured_of(artifact).reused if reused is None else reused
    told = f"{found.cells} cells through {found.through}, {found.failed} failed; {already} were there already"
    lines = [
        f"failed: {_label(found.settings[each.setting].label, each.seed)}: {each.message}"
        for each in found.failures[:TOLD_FAILURES]
    ]
    return Group(Text(str(artifact.id), "bold"), rows, "\n".join([told, *lines]))


def _title(metric: str) -> str:
    """Name the stage whose success a column shows, and the domain, if it has any."""
    stage, _, domain = metric.removesuffix(FIRST).rstrip(".").partition(".")
    return f"success of {stage or PRETRAIN.name}" + (f", {domain}" if domain else "")


def _mean(values: Array) -> str:
    """Write the mean of what is known."""
    known = [float(value) for value in values if value == value]
    return f"{sum(known) / len(known):.1%}, mean of {len(known)}" if known else "–"


def _label(setting: str, seed: int) -> str:
    return f"{setting}, seed {seed}" if setting else f"seed {seed}"


def _success(outcome: Outcome) -> str:
    """Write the success of a finished cell's last stage; of a transfer, the mean over its domains."""
    values = [outcome.metrics[name] for name in last_success(outcome.metrics)]
    return f"{sum(values) / len(values):.0%}" if values else ""


def _clock(seconds: float) -> str:
    whole = max(0, round(seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}" if whole >= 3600 else f"{whole // 60}:{whole % 60:02d}"
