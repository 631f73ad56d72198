"""The context of every command: the store, output, and progress."""

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

if TYPE_CHECKING:  # imported only if needed: `skill --help` must be instant
    from rich.console import Console, RenderableType

    from skillcli.progress import OnProgress
    from skillcli.store import ArtifactId, Store


@dataclass(frozen=True)
class Session:
    """The global options."""

    root: Path
    named: bool = False  # whether the user named this store
    json: bool = False
    quiet: bool = False
    debug: bool = False

    @property
    def store(self) -> Store:
        """Return the artifact store."""
        from skillcli.store import Store

        return Store(self.root)

    @property
    def filled(self) -> Store:
        """Return the store for a command that only reads; one that the user named must exist, the default may be missing.

        Raises:
            StoreError: it does not exist.
        """
        if not self.root.is_dir():
            message = f"there is no store {self.root}" + (": it is not a folder" if self.root.exists() else "")
            if self.named or self.root.exists():
                raise StoreError(message, f"{typed.PLACE} DIR or SKILL_STORE names the folder that holds the artifacts")
            self.say(f"{message} here: `skill demo` makes one, --store DIR names another")
        return self.store

    @property
    def out(self) -> Console:
        """Return the console for results, on stdout."""
        from skillcli.cli import terminal

        return terminal.out()

    @property
    def err(self) -> Console:
        """Return the console for messages, on stderr."""
        from skillcli.cli import terminal

        return terminal.err(self.quiet)

    @property
    def command(self) -> str:
        """Return the command as typed, without the options that only concern output and paths."""
        return typed.recorded()

    def say(self, message: str, style: str = "") -> None:
        """Print a message in one line on stderr."""
        if not self.json:
            self.err.print(line(typed.runnable(message)), style=style, soft_wrap=True)

    def result(self, payload: dict[str, Any], *shown: RenderableType) -> None:
        """Print the result: one JSON object, or its readable form."""
        if self.json:
            print(json.dumps(finite(payload)))
            return
        from rich.text import Text

        for item in shown:  # paths and commands must be easy to copy: their lines are not broken
            self.out.print(item, soft_wrap=isinstance(item, str | Text))

    def pick(self, text: str | None, *kinds: str) -> ArtifactId:
        """Resolve an id; without one, take the newest fitting artifact and name it."""
        found = self.store.resolve(text, kinds)
        if not text:
            self.say(f"using {found}, the newest that fits")
        return found

    @contextmanager
    def progress(self) -> Iterator[OnProgress]:
        """Show progress on stderr: live on a terminal, lines elsewhere, nothing when quiet."""
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
    """Convert to plain types, with null for NaN and infinities, for strict JSON."""
    if isinstance(item, dict):
        return {str(key): finite(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [finite(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return None
    return item
