"""Refuse model files that would need too much memory: a few lines can ask for more than any machine has."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

from skillcli.errors import UsageError

MAX_BYTES = 32 * 1024 * 1024  # of one file; a robot file without its meshes has some 100 kB
MAX_COPIES = 10_000  # of elements that one makes
MAX_SAMPLES = 4_000_000  # of a height field
# Element: the attributes whose numbers it multiplies, and how much may come of it.
_MAKES = {
    "replicate": (("count",), MAX_COPIES),
    "flexcomp": (("count",), MAX_COPIES),
    "composite": (("count",), MAX_COPIES),
    "hfield": (("nrow", "ncol"), MAX_SAMPLES),
}


def check_size(path: Path, seen: frozenset[Path] = frozenset()) -> None:
    """Refuse a file that is huge or makes a huge model, also through its includes. MuJoCo refuses what is not XML.

    Raises:
        UsageError: the file, or what it makes, is too large.
    """
    if path in seen or not path.is_file():
        return
    if path.stat().st_size > MAX_BYTES:
        raise UsageError(
            f"model: {path.name} has {path.stat().st_size / 2**20:.0f} MiB", f"at most {MAX_BYTES // 2**20} MiB are read"
        )
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (ElementTree.ParseError, ValueError, LookupError):  # LookupError: an unknown encoding
        return
    left = [(root, 1.0)]
    while left:
        element, copies = left.pop()
        names, most = _MAKES.get(element.tag, ((), math.inf))
        made = math.prod((_product(element.get(name, "1")) for name in names), start=1.0)
        if made * copies > most:
            raise UsageError(
                f"model: <{element.tag}> in {path.name} makes {made * copies:.3g} of what it holds",
                f"at most {most:g} can be made",
            )
        if element.tag == "include":
            check_size(path.parent / element.get("file", ""), seen | {path})
        left += [(child, copies * made if element.tag == "replicate" else copies) for child in element]


def _product(text: str) -> float:
    try:
        return math.prod((abs(float(word)) for word in text.split()), start=1.0)
    except ValueError:
        return 1.0  # MuJoCo says what is wrong
