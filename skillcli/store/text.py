"""JSON as the store writes it: one canonical spelling, so that equal values have equal hashes."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from skillcli.errors import StoreError


def plain(value: Any, where: str = "value") -> Any:
    """The value in JSON's own types: numpy scalars and arrays become numbers and lists, NaN and infinities null.

    Raises:
        StoreError: something in it has no JSON form; `where` tells the place.
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
    """Strict JSON with sorted keys and no spaces, ASCII only."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def parse(text: str | bytes) -> Any:
    """Read strict JSON.

    Raises:
        ValueError: it is not, or holds NaN or Infinity.
    """
    return _STRICT.decode(text if isinstance(text, str) else text.decode())


def sha256(value: Any) -> str:
    """Hash of the canonical JSON, 64 hexadecimal digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


_STRICT = json.JSONDecoder(parse_constant=_no_constant)  # made once: a store is listed by thousands of headers
