"""Resolve what a user types to one artifact id: full ids, series and prefixes, without reading the disk."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.kinds import EXECUTION, KINDS, PRETRAIN, SWEEP
from skillcli.store.ids import NAME, ArtifactId, file_pattern

_PREFIX = re.compile(rf"{NAME}(/[a-z0-9-]*)?", re.ASCII)
_SHOWN = 5
_COMMANDS = {EXECUTION.name: "execute", SWEEP.name: "sweep RECIPE"}  # where it is not the name of the kind


def match(text: str, known: Iterable[ArtifactId], kinds: Sequence[str] = ()) -> ArtifactId:
    """Return the artifact of a full id, `NAME/STAGE` (its newest version) or a unique prefix of either.

    Args:
        text: as typed.
        known: all existing ids.
        kinds: accepted kinds; empty for any.

    Raises:
        UnknownArtifact: the text matches nothing, or more than one series.
        StoreError: the text cannot be an id, or names an artifact of another kind.
    """
    if not _PREFIX.fullmatch(text):
        raise StoreError(f"not an artifact id or prefix: {text!r}", "give NAME/STAGE-vN, NAME/STAGE or a unique prefix")
    known = list(known)
    found = _candidates(text, known)
    if not found:
        raise unknown(text, known, kinds)
    fitting = [one for one in found if not kinds or one.stage in kinds]
    if not fitting:
        raise StoreError(
            f"expected an artifact of kind {' or '.join(kinds)}, got {text!r}, which is {_listed(found)}",
            _available(_related(found, [one for one in known if one.stage in kinds]), kinds, known),
        )
    if len({one.series for one in fitting}) > 1:
        raise UnknownArtifact(f"{text!r} could be {_listed(fitting)}", "type more of the id")
    return max(fitting)


def unknown(text: str, known: Sequence[ArtifactId], kinds: Sequence[str] = ()) -> UnknownArtifact:
    """Make the error for an unknown id; its hint lists similar ids, or else all available ones of the accepted kinds."""
    fitting = [one for one in known if not kinds or one.stage in kinds]
    names = sorted({str(one) for one in fitting} | {one.series for one in fitting})
    near = difflib.get_close_matches(text, names, n=3, cutoff=0.6)
    hint = f"did you mean {' or '.join(near)}?" if near else _available(fitting, kinds, known)
    return UnknownArtifact(f"no artifact {text!r}", hint)


def first_step(kinds: Sequence[str], known: Iterable[ArtifactId]) -> str:
    """Propose a command: it makes an artifact of the first of these kinds, or what that has to be made from.

    Args:
        kinds: wanted; empty for any.
        known: all existing ids.
    """
    wanted, there = kinds[0] if kinds else PRETRAIN.name, {one.stage for one in known}
    step = wanted
    while (parents := KINDS[step].made_from) and there.isdisjoint(parents):
        step = parents[0]
    command = f"`skill {_COMMANDS.get(step, step)}`"
    return f"make one with {command}" if step == wanted else f"begin with {command}"


def _candidates(text: str, known: Sequence[ArtifactId]) -> list[ArtifactId]:
    # A complete id or name has priority, even if it is also the beginning of another.
    if file_pattern(f"{NAME}/").fullmatch(text):
        return [one for one in known if str(one) == text]
    return [one for one in known if one.name == text] or [one for one in known if str(one).startswith(text)]


def _related(found: Sequence[ArtifactId], fitting: Sequence[ArtifactId]) -> Sequence[ArtifactId]:
    """Return those of the same runs, or of a sweep's cells, if there are any."""
    names = {one.name for one in found}
    return [one for one in fitting if any(f"{one.name}.".startswith(f"{name}.") for name in names)] or fitting


def _available(fitting: Sequence[ArtifactId], kinds: Sequence[str], known: Iterable[ArtifactId]) -> str:
    return f"available: {_listed(fitting)}" if fitting else f"there are none yet: {first_step(kinds, known)}"


def _listed(ids: Iterable[ArtifactId]) -> str:
    newest = sorted({one.series: one for one in sorted(ids)}.values())
    return ", ".join(map(str, newest[:_SHOWN])) + (f" and {len(newest) - _SHOWN} more" if len(newest) > _SHOWN else "")
