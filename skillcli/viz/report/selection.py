"""Select the artifacts of a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillcli.errors import SkillError, StoreError
from skillcli.kinds import EXECUTION, SWEEP, AnyKind, kind_spec
from skillcli.robots.config import is_path
from skillcli.store import Artifact, ArtifactId, Header, Store
from skillcli.sweeps.cell import sweep_of
from skillcli.viz.loading import scene_of
from skillcli.viz.scene import Scene, drawable, label

LIMIT = 100  # artifacts on one page
MOST_SWEEPS = 8  # on one page
PREFERRED = "reference"  # names with this prefix come first


@dataclass(frozen=True, eq=False)
class Exhibit:
    """An artifact and its scene."""

    artifact: Artifact
    scene: Scene

    @property
    def id(self) -> str:
        """Return the artifact's id."""
        return str(self.artifact.id)

    @property
    def name(self) -> str:
        """Return the name of its library."""
        return self.artifact.id.name

    @property
    def robot(self) -> str:
        """Return the name of the arm that the skills are of; "" for the default one, the paper's, and without an arm."""
        named = self.artifact.robot
        return label(Path(named).stem if is_path(named) else named)

    def value(self, *path: str | int) -> Any:
        """Return the value at a path of results or measured, such as ("results", "skills", 0, "success_rate"); None if unset.

        Raises:
            AttributeError: artifacts of this kind have no such value.
        """
        spec = kind_spec(self.artifact.kind)
        group, *steps = path
        found: Any = spec.results_of(self.artifact) if group == "results" else spec.measured_of(self.artifact)
        for step in steps:
            if found is not None:
                found = found[step] if isinstance(step, int) else getattr(found, step)
        return found


@dataclass(frozen=True)
class Material:
    """The artifacts of a report, the most important first."""

    exhibits: tuple[Exhibit, ...]
    skipped: tuple[tuple[ArtifactId | str, str], ...]
    left_out: int
    sweeps: tuple[Artifact, ...] = ()

    def find(self, kind: AnyKind, task: str = "", where: Callable[[Exhibit], bool] = lambda _: True) -> list[Exhibit]:
        """Return the exhibits of a kind, of a task (any by default), that fulfil a condition."""
        of_kind = [one for one in self.exhibits if kind.is_kind_of(one.artifact) and task in ("", one.scene.task)]
        return [one for one in of_kind if where(one)]


def select(store: Store, ids: Sequence[ArtifactId]) -> Material:
    """Select the given artifacts with all their ancestors; with none, the newest of every kind and name.

    Raises:
        SkillError: no artifact can be used.
        StoreError: a given one cannot be read.
    """
    listing = store.listing()
    skipped = [(one.id, one.problem) for one in listing.unreadable]
    everything = _asked(store, ids) if ids else list(_newest(listing.headers))
    wanted = [one for one in everything if one.stage != SWEEP.name]
    sweeps = [store.read(one) for one in everything if one.stage == SWEEP.name][:MOST_SWEEPS]
    exhibits = []
    for one in wanted[:LIMIT]:
        try:
            artifact = store.read(one)
            exhibits.append(Exhibit(artifact, drawable(scene_of(store, one))))
        except SkillError as error:
            if one in ids:
                raise
            skipped.append((one, error.message))
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
            # from another version: intact, but its results have another form
            skipped.append((one, f"its results are not those of its kind ({type(error).__name__}: {error})"))
    if not exhibits and not sweeps:
        _nothing(store, skipped)
    if not ids:
        exhibits.sort(key=lambda one: bool(one.robot))  # the paper's arm first
    known = set(wanted)
    return Material(
        tuple(exhibits),
        tuple((one, problem) for one, problem in skipped if not ids or one in known),
        max(0, len(wanted) - LIMIT),
        tuple(sweeps),
    )


def _nothing(store: Store, skipped: Sequence[tuple[ArtifactId | str, str]]) -> None:
    if skipped:
        one, problem = skipped[0]
        raise StoreError(
            f"none of the {len(skipped)} artifacts in {store.root} can be used; {one}: {problem}",
            "`skill verify --all` says more",
        )
    raise SkillError(
        f"there is nothing to report in {store.root}", "make something with `skill demo`, or name a store: --store DIR"
    )


def _asked(store: Store, ids: Sequence[ArtifactId]) -> list[ArtifactId]:
    """Return the given artifacts, and then their ancestors in migrated form, each once."""
    ancestors = [store.current(one) for asked in ids for one in store.lineage(asked) if store.path(one).exists()]
    return list(dict.fromkeys([*ids, *ancestors]))


def _newest(headers: Sequence[Header]) -> Iterator[ArtifactId]:
    """Return the newest artifact of every library and kind; of kinds without skills, the newest for each parent.

    Every execution is another experiment, so all of them are returned, last. References come first, then libraries with more
    descendants.
    Cells of sweeps are left to their sweep.
    """
    sweeps = frozenset(header.id.name for header in headers if SWEEP.name == header.kind)
    headers = [header for header in headers if not sweep_of(header.id.name, sweeps)]
    kinds: dict[str, set[str]] = {}
    for header in headers:
        kinds.setdefault(header.id.name, set()).add(header.kind)

    def rank(header: Header) -> tuple[bool, bool, int]:
        return header.kind == EXECUTION.name, not header.id.name.startswith(PREFERRED), -len(kinds[header.id.name])

    seen = set()
    newest_first = headers[::-1]
    for header in sorted(newest_first, key=rank):
        several = not kind_spec(header.kind).holds("skills") and header.inputs_sha256
        one_of_many = str(header.id) if header.kind == EXECUTION.name else header.inputs_sha256 if several else ""
        key = (header.id.name, header.kind, one_of_many)
        if key not in seen:
            seen.add(key)
            yield header.id
