"""What every command shares: the store, how to print, and how progress is shown."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # imported where needed: `skill --help` must be instant
    from rich.console import Console, RenderableType

    from skillcli.stages.progress import Progress, Report
    from skillcli.store import ArtifactId, Store

PLAIN_SECONDS = 10.0  # between progress lines where there is no terminal


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
        elif self.err.is_terminal and not self.json:
            with _live(self.err) as report:
                yield report
        else:
            yield _plain(self.err)


def finite(item: Any) -> Any:
    """The same with plain types, and null for NaN and infinities: strict JSON."""
    if isinstance(item, dict):
        return {str(key): finite(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [finite(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return None
    return item


@contextmanager
def _live(console: Console) -> Iterator[Report]:
    from rich.live import Live

    clock = Clock()
    with Live(console=console, refresh_per_second=8, transient=True) as live:
        yield lambda progress: live.update(panel(progress, clock.left(progress)))


def _plain(console: Console) -> Report:
    clock, last = Clock(), time.monotonic()

    def report(progress: Progress) -> None:
        nonlocal last
        left, now = clock.left(progress), time.monotonic()
        if now - last >= PLAIN_SECONDS:
            last = now
            console.print(line(progress, left), highlight=False, soft_wrap=True)

    return report


class Clock:
    """Estimates the time left of each stage from its own beginning, which a resumed one has behind it."""

    def __init__(self) -> None:
        self._stage, self._began, self._first = "", 0.0, 0

    def left(self, progress: Progress) -> str:
        """Minutes and seconds left, "?" as long as nothing can be said."""
        if progress.stage != self._stage:
            self._stage, self._began, self._first = progress.stage, time.monotonic(), progress.done
        done = progress.done - self._first
        if done <= 0:
            return "?"
        seconds = round((time.monotonic() - self._began) * (progress.total - progress.done) / done)
        return f"{seconds // 60}:{seconds % 60:02d}"


def line(progress: Progress, left: str) -> str:
    """Progress as one line."""
    parts = [f"{progress.stage} {progress.done}/{progress.total} {progress.unit}"]
    if progress.rate:
        parts.append(f"{progress.rate:,.0f} steps/s")
    if progress.success:
        parts.append(f"success {sum(progress.success.values()) / len(progress.success):.0%}")
    parts += [progress.note] if progress.note else []
    return " · ".join([*parts, f"{left} left"])


def panel(progress: Progress, left: str) -> RenderableType:
    """Progress as a bar, with the success of each skill as a small bar below."""
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.text import Text

    head = Text(line(progress, left), overflow="ellipsis", no_wrap=True)
    bars = Text(no_wrap=False)
    for name, share in progress.success.items():
        filled = "▁▂▃▄▅▆▇█"[min(7, int(share * 8))]
        style = "green" if share >= 0.95 else "yellow" if share >= 0.5 else "red"
        bars.append(f"{name} ").append(f"{filled} {share:4.0%}", style).append("   ")
    return Group(head, ProgressBar(progress.total, progress.done, width=50), bars)
