"""Text from files and from the system, made safe to look at: nothing in it moves a cursor, turns the line or hides."""

from __future__ import annotations

import re

_FENCES = re.compile("`+")
_MARKDOWN = str.maketrans({mark: f"\\{mark}" for mark in r"\`*_{}[]()<>#+-!|&~="})
_KEPT = "\n\t\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{EN SPACE}\N{THIN SPACE}"


def visible(text: str) -> str:
    """The text with whatever cannot be seen written out: escapes, other control characters, reversals, lone surrogates.

    Line breaks and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(mark if mark.isprintable() or mark in _KEPT else _written_out(mark) for mark in text)


def line(text: str) -> str:
    """The same in one line."""
    return visible(" ".join(text.split()))


def markdown(text: str) -> str:
    """The same in one line that Markdown takes for plain text."""
    return line(text).translate(_MARKDOWN)


def code(text: str) -> str:
    """The same in one line that Markdown takes for code, whatever backticks are in it."""
    shown = line(text)
    fence = "`" * (1 + max(map(len, _FENCES.findall(shown)), default=0))
    return f"{fence} {shown} {fence}"


def _written_out(mark: str) -> str:
    return mark.encode("unicode_escape", "surrogatepass").decode("ascii")
