"""What every command shares: the store, how to print, and how progress is shown."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # imported where needed: `skill --help` must be instant
    from rich.console import Console, RenderableType

    from skillcli.stages.progress import Report
    from skillcli.store import ArtifactId, Store


@dataclass(frozen=True)
class Session:
    """The options that stand before the command."""

    root: Path
    json: bool = False
    quiet: bool = False
    debug: bool = False

    @property
    def store(self) -> Store:
        """The artifact store."""
        from skillcli.store import Store

        return Store(self.root)

    @property
    def out(self) -> Console:
        """Results, on stdout."""
        from rich.console import Console

        console = Console()
        # nobody reads a pipe at 80 columns: nothing is cut there, unless COLUMNS asks for it
        return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=160)

    @property
    def err(self) -> Console:
        """Messages, on stderr."""
        from rich.console import Console

        return Console(stderr=True, quiet=self.quiet)

    @property
    def command(self) -> str:
        """The command as typed, without the options that only concern printing and places."""
        words = sys.argv[1:]
        kept = [word for word in words if word not in ("--json", "--quiet", "--debug")]
        if "--store" in kept:
            at = kept.index("--store")
            kept = kept[:at] + kept[at + 2 :]
        return shlex.join(["skill", *(word for word in kept if not word.startswith("--store="))])

    def say(self, message: str) -> None:
        """A message for a person, on stderr."""
        if not self.json:
            self.err.print(message, highlight=False)

    def result(self, payload: dict[str, Any], *shown: RenderableType) -> None:
        """What a command found out: one JSON object, or what is shown to a person."""
        if self.json:
            print(json.dumps(finite(payload)))
            return
        for item in shown:
            self.out.print(item, highlight=False)

    def pick(self, text: str | None, *kinds: str) -> ArtifactId:
        """Resolve an id; where none is given, take the newest fitting artifact and say which."""
        found = self.store.resolve(text, kinds)
        if not text:
            self.say(f"taking {found}, the newest that fits")
        return found

    @contextmanager
    def progress(self) -> Iterator[Report]:
        """Show progress on stderr: live on a terminal, a line now and then elsewhere, nothing when quiet."""
        if self.quiet:
            yield lambda _: None
            return
        from skillcli.cli import watching

        console = self.err
        if console.is_terminal and not console.is_dumb_terminal and not self.json:
            with watching.live(console) as report:
                yield report
        else:
            yield watching.plain(console)


def finite(item: Any) -> Any:
    """The same with plain types, and null for NaN and infinities: strict JSON."""
    if isinstance(item, dict):
        return {str(key): finite(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [finite(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return None
    return item
