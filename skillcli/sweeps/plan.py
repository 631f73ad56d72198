"""Which cells a sweep has, and what became of them."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from skillcli.errors import UsageError
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL
from skillcli.recipe import Recipe, load_recipe
from skillcli.store.ids import NAME_LENGTH
from skillcli.sweeps.axes import MAX_CELLS, Setting
from skillcli.sweeps.cell import STOPPED, Cell, Outcome, cell_label, cell_name

THROUGH = (PRETRAIN.name, EMBED_MEANS.name, COMPOSE.name, TRANSFER_EVAL.name)
"""Stages that a cell may end with."""


@dataclass(frozen=True)
class SweepPlan:
    """Which cells there are, by setting and within it by seed.

    Args:
        recipe: by name or path, as typed.
        settings: combinations of values.
        seeds: of each.
        name: first part of all ids.
        through: the last stage of every cell.
        told: keys that names and labels tell; None for those that have several values.

    Raises:
        UsageError: a recipe is invalid, there are too many cells, or the name is too long for those of its cells.
    """

    recipe: str
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    name: str
    through: str = PRETRAIN.name
    told: frozenset[str] | None = None

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
    def _varied_keys(self) -> frozenset[str]:
        if self.told is not None:
            return self.told
        first, *others = self.settings
        pairs = (pair for other in others for pair in zip(other, first, strict=True))
        return frozenset(key for (key, value), (_, base) in pairs if value != base)

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

    def cell(self, setting: int, turn: int, recipe: Mapping[str, Any]) -> Cell:
        """Make the cell of a setting and of a seed, both by their place."""
        seed, values = self.seeds[turn], self.settings[setting]
        name = cell_name(self.name, self.varied(setting), seed)
        sets = [word for key, value in values for word in ("--set", f"{key}={value}")]
        what = PRETRAIN.name if self.through == PRETRAIN.name else "run"
        by_hand = shlex.join(["skill", what, self.recipe, "--seed", str(seed), *sets, "--name", name])
        return Cell(setting * len(self.seeds) + turn, setting, seed, name, self.through, recipe, by_hand)

    def label(self, index: int) -> str:
        """Return a cell as people read it."""
        setting, seed = self.place(index)
        return cell_label(self.varied(setting), seed)

    def place(self, index: int) -> tuple[int, int]:
        """Return setting and seed of a cell."""
        setting, turn = divmod(index, len(self.seeds))
        return setting, self.seeds[turn]


@dataclass
class Tally:
    """What became of the cells so far; a few numbers for each."""

    outcomes: dict[int, Outcome] = field(default_factory=dict)

    def add(self, outcome: Outcome) -> None:
        """Take an outcome."""
        if outcome.state != STOPPED:
            self.outcomes[outcome.index] = outcome

    def count(self, state: str) -> int:
        """Return how many cells are in a state."""
        return sum(outcome.state == state for outcome in self.outcomes.values())
