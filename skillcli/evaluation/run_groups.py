"""Groups of runs to compare: the settings of a sweep, whole sweeps, or single artifacts that share a recipe."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skillcli.errors import UsageError
from skillcli.evaluation.run_metrics import METRICS, metrics_of
from skillcli.kinds import PRETRAIN, SWEEP
from skillcli.kinds.sweep import DONE, sha_text
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.trajectories import Array

_SHOWN = 4  # keys in which recipes differ, in a label


@dataclass(frozen=True, eq=False)
class Member:
    """One run."""

    seed: int
    stratum: int
    metrics: Mapping[str, float]
    content_sha256: str  # of its last artifact


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of one setting, or of several that all groups share."""

    label: str
    members: tuple[Member, ...]

    def strata(self, metric: str) -> dict[int, dict[int, float]]:
        """Return the values of a metric by stratum and seed, without runs in which it is undefined."""
        found: dict[int, dict[int, float]] = {}
        for member in self.members:
            value = member.metrics.get(metric, np.nan)
            if np.isfinite(value):
                found.setdefault(member.stratum, {})[member.seed] = float(value)
        return found

    @cached_property
    def metrics(self) -> list[str]:
        """Return the metrics that any run has, in order."""
        return list(dict.fromkeys(name for member in self.members for name in member.metrics))


def groups_of(store: Store, ids: Sequence[ArtifactId]) -> list[Group]:
    """Make the groups to compare.

    Of one sweep every setting is a group. Several sweeps with the same settings are a group each, with the settings as strata;
    with different ones, every setting of every sweep is a group. Single artifacts are grouped by their recipe.

    Raises:
        UsageError: sweeps and single artifacts are mixed, a kind has nothing to compare, or a run is given twice.
        StoreError: one cannot be read.
    """
    sweeps = [one for one in ids if one.stage == SWEEP.name]
    if sweeps and len(sweeps) < len(ids):
        raise UsageError("sweeps and single artifacts cannot be compared with each other", "give only one sort")
    if len(set(ids)) < len(ids):
        raise UsageError("an id stands twice", "give each once")
    if sweeps:
        return _of_sweeps([store.read(one) for one in sweeps])
    return _of_artifacts(store, ids)


def _of_sweeps(sweeps: Sequence[Artifact]) -> list[Group]:
    found = [SWEEP.results_of(one) for one in sweeps]
    names = [str(one.id) for one in sweeps]
    same = all(each.settings == found[0].settings and each.through == found[0].through for each in found)
    if len(sweeps) > 1 and same:
        return [Group(name, tuple(_members(one))) for name, one in zip(names, sweeps, strict=True)]
    every = [setting.values for results in found for setting in results.settings]
    groups = []
    for name, one, results in zip(names, sweeps, found, strict=True):
        for index, setting in enumerate(results.settings):
            told = setting.label or _differing(setting.values, every)
            label = ": ".join(part for part in (name if len(sweeps) > 1 else "", told) if part)
            groups.append(Group(label or name, tuple(_members(one, index))))
    return groups


def _differing(values: Mapping[str, str], every: Sequence[Mapping[str, str]]) -> str:
    """Name a setting that is alone in its sweep by the keys in which it differs from any other that is compared."""
    return ", ".join(f"{key}={value}" for key, value in values.items() if any(other.get(key) != value for other in every))


def shared_runs(groups: Sequence[Group]) -> int:
    """Return how many runs belong to more than one group."""
    every = [one for group in groups for one in {member.content_sha256 for member in group.members}]
    return sum(count > 1 for count in Counter(every).values())


def _members(sweep: Artifact, only: int | None = None) -> Iterator[Member]:
    """Yield the finished runs of a sweep, of one setting alone or of all, each its own stratum."""
    metrics = sweep.group("metrics")
    cells = (sweep.arrays[f"cells/{name}"] for name in ("setting", "seed", "state", "content"))
    for index, (setting, seed, state, content) in enumerate(zip(*cells, strict=True)):
        if state == DONE and only in (None, int(setting)):
            values = {name: float(column[index]) for name, column in metrics.items() if not np.isnan(column[index])}
            yield Member(int(seed), 0 if only is not None else int(setting), values, sha_text(content))


def _of_artifacts(store: Store, ids: Sequence[ArtifactId]) -> list[Group]:
    by_recipe: dict[tuple[str, str], list[Artifact]] = {}
    for one in ids:
        if one.stage not in METRICS:
            METRICS.of(one.stage)
        artifact = store.read(one)
        by_recipe.setdefault((one.stage, artifact.recipe_sha256), []).append(artifact)
    if len(kinds := sorted({stage for stage, _ in by_recipe})) > 1:
        raise UsageError(f"{' and '.join(kinds)} cannot be compared with each other", "give artifacts of one kind")
    recipes = [dict(_flat(runs[0].recipe)) for runs in by_recipe.values()]
    groups = []
    for runs, label in zip(by_recipe.values(), _labels(recipes), strict=True):
        seeds = [run.seed for run in runs]
        if repeated := next((run for run in runs if seeds.count(run.seed) > 1), None):
            raise UsageError(
                f"{repeated.id}: another one has the same recipe and seed {repeated.seed}", "give one run of each seed"
            )
        members = (Member(run.seed, 0, metrics_of([run]), run.content_sha256) for run in runs)
        groups.append(Group(label, tuple(members)))
    return groups


def _labels(recipes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Name recipes by their names, or where these are the same by the keys in which they differ."""
    names = [str(recipe.get("name", "")) for recipe in recipes]
    if len(set(names)) == len(names):
        return names
    keys = dict.fromkeys(key for recipe in recipes for key in recipe)
    differing = [key for key in keys if len({repr(recipe.get(key)) for recipe in recipes}) > 1 and key != "description"]
    return [", ".join(f"{key}={recipe.get(key)}" for key in differing[:_SHOWN]) for recipe in recipes]


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}.{key}" if path else str(key))
    else:
        yield path, value


@dataclass(frozen=True)
class Curve:
    """The success of a run over its training."""

    steps: Array  # (T,) control steps
    success: Array  # (T,)


def curves_of(store: Store, group: Group) -> list[Curve]:
    """Read the learning curves of a group's runs, one file at a time; runs that are gone are left out."""
    wanted = {member.content_sha256 for member in group.members}
    found = []
    for header in [header for header in store.headers() if header.content_sha256 in wanted]:
        wanted.discard(header.content_sha256)
        trained = next((one for one in (header.id, *store.lineage(header.id)) if one.stage == PRETRAIN.name), None)
        if trained is not None and store.path(trained).exists():
            curves = store.read(trained).group("curves")
            if {"env_steps", "success_rate"} <= curves.keys():
                found.append(Curve(curves["env_steps"], curves["success_rate"]))
    return found
