"""Ids of artifacts, `NAME/STAGE-vN`: one regular expression parses them and one method formats them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from skillcli.errors import StoreError
from skillcli.kinds import KINDS

STAGES = tuple(KINDS)
"""Every stage writes one kind of artifact of the same name."""

LAST_VERSION = 999_999_999

NAME_LENGTH = 64
NAME = rf"(?!.*\.\.)[A-Za-z0-9][A-Za-z0-9._-]{{0,{NAME_LENGTH - 1}}}"


def file_pattern(before: str = "", after: str = "") -> re.Pattern[str]:
    """Return a pattern for `STAGE-vN` with groups `stage` and `version`, between two others, for every kind."""
    return _file_pattern(before, after, tuple(KINDS))


@cache
def _file_pattern(before: str, after: str, kinds: tuple[str, ...]) -> re.Pattern[str]:
    return re.compile(rf"{before}(?P<stage>{'|'.join(kinds)})-v(?P<version>[1-9][0-9]{{0,8}}){after}", re.ASCII)


_NAMED = rf"(?P<name>{NAME})/"


def _rule() -> str:
    return f"an id is NAME/STAGE-vN: NAME of letters, digits, '.', '_', '-' (at most 64), STAGE one of {', '.join(KINDS)}"


@dataclass(frozen=True, order=True)
class ArtifactId:
    """Identity of one artifact; sorts by name, stage and version.

    Raises:
        StoreError: the parts do not make a valid id.
    """

    name: str
    stage: str
    version: int

    def __post_init__(self) -> None:
        """Refuse parts that would not parse back, such as a name that leaves the store's folder."""
        if not file_pattern(_NAMED).fullmatch(str(self)):
            raise StoreError(f"not an artifact id: {str(self)!r}", _rule())

    def __str__(self) -> str:
        """Format as `NAME/STAGE-vN`."""
        return f"{self.name}/{self.stage}-v{self.version}"

    @classmethod
    def parse(cls, text: str) -> ArtifactId:
        """Read a full id.

        Raises:
            StoreError: the text is not one.
        """
        found = file_pattern(_NAMED).fullmatch(text)
        if not found:
            raise StoreError(f"not an artifact id: {text!r}", _rule())
        return cls(found["name"], found["stage"], int(found["version"]))

    @property
    def series(self) -> str:
        """Return `NAME/STAGE`, which all versions share."""
        return f"{self.name}/{self.stage}"

    def path(self, root: Path) -> Path:
        """Return the artifact's path in the store at `root`."""
        return root / self.name / f"{self.stage}-v{self.version}.h5"


def check_name(name: str) -> str:
    """Return the name if it is valid.

    Raises:
        StoreError: it cannot be the first part of an id.
    """
    return ArtifactId(name, next(iter(KINDS)), 1).name
