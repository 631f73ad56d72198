"""The console that everything is printed on: text is text there, whatever it says and wherever it came from."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from skillcli.plaintext import visible

PIPE_WIDTH = 160  # nobody reads a pipe at 80 columns: nothing is cut there, unless COLUMNS asks for it


class Terminal(Console):
    """A console without markup; control characters in text are written out, so that only our own styles reach the terminal."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See rich; this is what every text passes through."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)

    def render_str(self, text: str, **options: Any) -> Text:
        """See rich; written out here already, a text is as wide as it is measured."""
        return super().render_str(visible(text), **options)


def out() -> Console:
    """Results, on stdout."""
    console = Terminal()
    return console if console.is_terminal or "COLUMNS" in os.environ else Terminal(width=PIPE_WIDTH)


def err(quiet: bool) -> Console:
    """Messages, on stderr."""
    return Terminal(stderr=True, quiet=quiet)
