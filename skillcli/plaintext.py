"""Make texts from files and from the system safe to print: nothing moves a cursor, reverses the line or hides."""

from __future__ import annotations

import re

_FENCES = re.compile("`+")
_MARKDOWN = str.maketrans({mark: f"\\{mark}" for mark in r"\`*_{}[]()<>#+-!|&~="})
_KEPT = "\n\t\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{EN SPACE}\N{THIN SPACE}"


def visible(text: str) -> str:
    """Write out invisible characters: escapes, other control characters, reversals, lone surrogates.

    Line breaks and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(mark if mark.isprintable() or mark in _KEPT else _written_out(mark) for mark in text)


def line(text: str) -> str:
    """Make the text safe, in one line."""
    return visible(" ".join(text.split()))


def markdown(text: str) -> str:
    """Make the text safe, in one line that Markdown shows as plain text."""
    return line(text).translate(_MARKDOWN)


def code(text: str) -> str:
    """Make the text safe, in one line that Markdown shows as code, whatever backticks are in it."""
    shown = line(text)
    fence = "`" * (1 + max(map(len, _FENCES.findall(shown)), default=0))
    return f"{fence} {shown} {fence}"


def _written_out(mark: str) -> str:
    return mark.encode("unicode_escape", "surrogatepass").decode("ascii")
