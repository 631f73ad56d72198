"""The console for all output: text is never interpreted as markup, whatever its origin."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from skillcli.plaintext import visible

PIPE_WIDTH = 160  # nothing is cut in a pipe, unless COLUMNS asks for it


class Terminal(Console):
    """A console without markup; control characters in texts are escaped, so that only our own styles reach the terminal."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See rich; every text passes through here."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)

    def render_str(self, text: str, **options: Any) -> Text:
        """See rich; escaping here already makes the measured width of a text right."""
        return super().render_str(visible(text), **options)


def out() -> Console:
    """Return the console for results, on stdout."""
    console = Terminal()
    return console if console.is_terminal or "COLUMNS" in os.environ else Terminal(width=PIPE_WIDTH)


def err(quiet: bool) -> Console:
    """Return the console for messages, on stderr."""
    return Terminal(stderr=True, quiet=quiet)
