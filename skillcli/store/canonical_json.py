"""JSON in one canonical form, so that equal values have equal hashes."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from skillcli.errors import StoreError

MAX_DEPTH = 32  # nested lists and objects; an artifact's recipe has five
MAX_DIGITS = 40  # of an integer; the state of a generator has 39

_STRINGS_AND_REST = re.compile(r'"(?:[^"\\]|\\.)*+"?|[^][{}"]+', re.DOTALL)  # linear time, even without a closing quote
_INNERMOST = re.compile(r"\[\]|\{\}")


def plain(value: Any, where: str = "value") -> Any:
    """Convert a value to JSON's own types: numpy scalars and arrays to numbers and lists, NaN and infinities to null.

    Raises:
        StoreError: something in it has no JSON form; `where` names the place.
    """
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), where)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    raise StoreError(f"{where} cannot be stored as JSON: {type(value).__name__}", "use numbers, text, lists, str keys")


def canonical(value: Any) -> str:
    """Write strict JSON with sorted keys and no spaces, ASCII only."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def parse(text: str | bytes) -> Any:
    """Read strict JSON that this store could have written.

    Raises:
        ValueError: it is invalid, nested too deeply, repeats a key, or has a number that is not finite or too long.
    """
    decoded = text if isinstance(text, str) else text.decode()
    _check_depth(decoded)
    return _STRICT.decode(decoded)


def sha256(value: Any) -> str:
    """Hash the canonical JSON; 64 hexadecimal digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def _check_depth(text: str) -> None:
    """Check the nesting before parsing: a recursive parser can exhaust its stack."""
    if text.count("[") + text.count("{") <= MAX_DEPTH:
        return
    brackets = _STRINGS_AND_REST.sub("", text)
    for _ in range(MAX_DEPTH):
        brackets = _INNERMOST.sub("", brackets)
    if brackets:
        raise ValueError(f"its JSON is nested more than {MAX_DEPTH} deep")


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _integer(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"its JSON holds an integer of {len(digits)} digits")
    return int(digits)


def _finite(number: str) -> float:
    found = float(number)
    if not math.isfinite(found):
        raise ValueError(f"{number[:20]} is not a finite number")
    return found


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"its JSON says {twice[:40]!r} more than once")
    return found


# made once: a listing reads thousands of headers
_STRICT = json.JSONDecoder(parse_constant=_no_constant, parse_int=_integer, parse_float=_finite, object_pairs_hook=_once_each)
