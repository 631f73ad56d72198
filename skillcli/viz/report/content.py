"""The content of a report page: plain data; its texts come from artifacts and are not trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Number:
    """A number as shown, and its origin."""

    text: str
    artifact: str  # its id
    key: str  # such as "results.skills[0].final_distance_m"


@dataclass(frozen=True)
class Row:
    """One line of a table: the paper's result and ours."""

    what: str
    paper: str  # "" if the paper gives none
    here: Number | None  # None: no result yet
    verdict: str  # "better", "falls short", … or ""
    todo: str = ""  # command that would give the missing number


@dataclass(frozen=True)
class Table:
    """Numbers of one theme."""

    title: str
    rows: Sequence[Row]
    note: str = ""


@dataclass(frozen=True)
class ReportFigure:
    """A finished figure."""

    slug: str  # file name without suffix
    paper_figure: str  # "5", or "" for one that is not in the paper
    title: str
    caption: str
    artifacts: Sequence[str]
    files: Mapping[str, bytes]  # by suffix: svg, png, pdf


@dataclass(frozen=True)
class Missing:
    """A figure that could not be drawn, or an artifact that could not be used, and the reason."""

    what: str
    reason: str


@dataclass(frozen=True)
class Origin:
    """The origin of an artifact."""

    id: str
    kind: str
    content_sha256: str
    recipe_name: str
    recipe_sha256: str
    seed: int
    created_utc: str
    git: str
    command: str
    parents: Sequence[tuple[str, str]]  # id, content hash at that time
    packages: str


@dataclass(frozen=True)
class RecipeText:
    """A recipe as it was used."""

    name: str
    sha256: str
    text: str
    artifacts: Sequence[str]


@dataclass(frozen=True)
class ComparedGroup:
    """How well a group of runs does."""

    label: str
    n: int
    iqm: str
    interval: str


@dataclass(frozen=True)
class ComparedMetric:
    """One metric of all groups of a sweep, and what can be told of them."""

    name: str
    groups: Sequence[ComparedGroup]
    told: Sequence[str]


@dataclass(frozen=True)
class Comparison:
    """A sweep: its settings compared."""

    artifact: str
    metrics: Sequence[ComparedMetric]
    figure: ReportFigure


@dataclass(frozen=True, kw_only=True)
class Page:
    """Everything on the page."""

    figures: Sequence[ReportFigure]
    comparisons: Sequence[Comparison]
    tables: Sequence[Table]
    origins: Sequence[Origin]
    recipes: Sequence[RecipeText]
    not_drawn: Sequence[Missing]
    skipped: Sequence[Missing]
    left_out: int  # older artifacts that are not used
    version: str  # of skill

    @property
    def todo(self) -> list[Row]:
        """Return the rows without a number that have a command for it."""
        return [row for table in self.tables for row in table.rows if row.todo]
