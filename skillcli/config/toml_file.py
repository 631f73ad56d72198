"""Read TOML files written in any editor."""

from __future__ import annotations

import codecs
import tomllib
from pathlib import Path
from typing import Any

from skillcli.paths import read_small

MAX_BYTES = 256 * 1024  # larger than any recipe, domain or robot file


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; a byte-order mark, as Windows editors write it, is skipped.

    Raises:
        OSError: it cannot be opened or read.
        ValueError: it is not a regular file, too large, not UTF-8, or not TOML; the message is one line.
    """
    return parse_toml(_text(read_small(path, MAX_BYTES)))


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text.

    Raises:
        ValueError: it is not TOML, is nested too deeply, or has a number of absurd length.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError:  # Python's own limit of digits
        raise ValueError("a number in it has thousands of digits") from None


def _text(raw: bytes) -> str:
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in raw:
        raise ValueError("it is UTF-16 text or no text at all; save it as UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"it is no UTF-8 text: byte {error.start + 1} cannot be read; save it as UTF-8") from None
