"""What every command shares: the store, how to print, and how progress is shown."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillcli.cli import typed
from skillcli.errors import StoreError
from skillcli.plaintext import line

if TYPE_CHECKING:  # imported where needed: `skill --help` must be instant
    from rich.console import Console, RenderableType

    from skillcli.progress import OnProgress
    from skillcli.store import ArtifactId, Store


@dataclass(frozen=True)
class Session:
    """The options for every command."""

    root: Path
    named: bool = False  # whether somebody asked for this store
    json: bool = False
    quiet: bool = False
    debug: bool = False

    @property
    def store(self) -> Store:
        """The artifact store."""
        from skillcli.store import Store

        return Store(self.root)

    @property
    def filled(self) -> Store:
        """The store, for a command that only looks: one that was asked for must be there, the usual one may come later.

        Raises:
            StoreError: it is not there.
        """
        if not self.root.is_dir():
            message = f"there is no store {self.root}" + (": it is not a folder" if self.root.exists() else "")
            if self.named or self.root.exists():
                raise StoreError(message, f"{typed.PLACE} DIR or SKILL_STORE names the folder that holds the artifacts")
            self.say(f"{message} here: `skill demo` makes one, --store DIR names another")
        return self.store

    @property
    def out(self) -> Console:
        """Results, on stdout."""
        from skillcli.cli import terminal

        return terminal.out()

    @property
    def err(self) -> Console:
        """Messages, on stderr."""
        from skillcli.cli import terminal

        return terminal.err(self.quiet)

    @property
    def command(self) -> str:
        """The command as typed, without the options that only concern printing and places."""
        return typed.recorded()

    def say(self, message: str, style: str = "") -> None:
        """A message for a person, in one line on stderr."""
        if not self.json:
            self.err.print(line(typed.runnable(message)), style=style, soft_wrap=True)

    def result(self, payload: dict[str, Any], *shown: RenderableType) -> None:
        """What a command found out: one JSON object, or what is shown to a person."""
        if self.json:
            print(json.dumps(finite(payload)))
            return
        from rich.text import Text

        for item in shown:  # paths and commands are there to be copied: no line is broken in them
            self.out.print(item, soft_wrap=isinstance(item, str | Text))

    def pick(self, text: str | None, *kinds: str) -> ArtifactId:
        """Resolve an id; where none is given, take the newest fitting artifact and say which."""
        found = self.store.resolve(text, kinds)
        if not text:
            self.say(f"taking {found}, the newest that fits")
        return found

    @contextmanager
    def progress(self) -> Iterator[OnProgress]:
        """Show progress on stderr: live on a terminal, a line now and then elsewhere, nothing when quiet."""
        if self.quiet:
            yield lambda _: None
            return
        from skillcli.cli import progress_view

        console = self.err
        if console.is_terminal and not console.is_dumb_terminal and not self.json:
            with progress_view.live(console) as on_progress:
                yield on_progress
        else:
            yield progress_view.plain(console)


def finite(item: Any) -> Any:
    """The same with plain types, and null for NaN and infinities: strict JSON."""
    if isinstance(item, dict):
        return {str(key): finite(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [finite(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return None
    return item
