"""What a report page is made of: plain data, all of it text from artifacts that nobody has to trust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Number:
    """A number as it is shown, and where it was read."""

    text: str
    artifact: str  # its id
    key: str  # such as "results.skills[0].final_distance_m"


@dataclass(frozen=True)
class Row:
    """One line of a table: what the paper reached and what was reached here."""

    what: str
    paper: str  # "" where the paper says nothing
    here: Number | None  # None: nothing here yet
    verdict: str  # "better", "falls short", … or ""
    todo: str = ""  # the command that would give the number, where there is none


@dataclass(frozen=True)
class Table:
    """Numbers of one theme."""

    title: str
    rows: Sequence[Row]
    note: str = ""


@dataclass(frozen=True)
class Drawing:
    """A figure, drawn."""

    slug: str  # file name without suffix
    paper_figure: str  # "5", or "" for one of our own
    title: str
    caption: str
    artifacts: Sequence[str]
    files: Mapping[str, bytes]  # by suffix: svg, png, pdf


@dataclass(frozen=True)
class Missing:
    """A figure that could not be drawn, or an artifact that could not be used, and why."""

    what: str
    reason: str


@dataclass(frozen=True)
class Origin:
    """Where an artifact comes from."""

    id: str
    kind: str
    content_sha256: str
    recipe_name: str
    recipe_sha256: str
    seed: int
    created_utc: str
    git: str
    command: str
    parents: Sequence[tuple[str, str]]  # id, content hash as it was then
    packages: str


@dataclass(frozen=True)
class RecipeText:
    """A recipe as it was used."""

    name: str
    sha256: str
    text: str
    artifacts: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Page:
    """Everything on the page."""

    drawings: Sequence[Drawing]
    tables: Sequence[Table]
    origins: Sequence[Origin]
    recipes: Sequence[RecipeText]
    not_drawn: Sequence[Missing]
    skipped: Sequence[Missing]
    left_out: int  # older artifacts that are not looked at
    version: str  # of skill

    @property
    def todo(self) -> list[Row]:
        """Rows without a number that a command would give."""
        return [row for table in self.tables for row in table.rows if row.todo]
