"""Resolve what a user types to one artifact id: full ids, series and prefixes, without reading the disk."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.store.ids import NAME, ArtifactId, file_pattern

_PREFIX = re.compile(rf"{NAME}(/[a-z0-9-]*)?", re.ASCII)
_SHOWN = 5


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
        raise unknown(text, known)
    fitting = [one for one in found if not kinds or one.stage in kinds]
    if not fitting:
        raise StoreError(
            f"expected an artifact of kind {' or '.join(kinds)}, got {text!r}, which is {_listed(found)}",
            _available([one for one in known if one.stage in kinds]),
        )
    if len({one.series for one in fitting}) > 1:
        raise UnknownArtifact(f"{text!r} could be {_listed(fitting)}", "type more of the id")
    return max(fitting)


def unknown(text: str, known: Sequence[ArtifactId]) -> UnknownArtifact:
    """Make the error for an unknown id; its hint lists similar ids, or else all available ones."""
    names = sorted({str(one) for one in known} | {one.series for one in known})
    near = difflib.get_close_matches(text, names, n=3, cutoff=0.6)
    hint = f"did you mean {' or '.join(near)}?" if near else _available(known)
    return UnknownArtifact(f"no artifact {text!r}", hint)


def _candidates(text: str, known: Sequence[ArtifactId]) -> list[ArtifactId]:
    # A complete id or name has priority, even if it is also the beginning of another.
    if file_pattern(f"{NAME}/").fullmatch(text):
        return [one for one in known if str(one) == text]
    return [one for one in known if one.name == text] or [one for one in known if str(one).startswith(text)]


def _available(known: Sequence[ArtifactId]) -> str:
    return f"available: {_listed(known)}" if known else "there are none yet"


def _listed(ids: Iterable[ArtifactId]) -> str:
    newest = sorted({one.series: one for one in sorted(ids)}.values())
    return ", ".join(map(str, newest[:_SHOWN])) + (f" and {len(newest) - _SHOWN} more" if len(newest) > _SHOWN else "")
