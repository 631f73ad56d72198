"""Files made to do harm, as small functions that make them; every hash around the harm is right.

`CASES` lists them by name, `FAMILY.CASE`. `python -m tests.store.attack` shows what `skill` makes of each.
"""

from __future__ import annotations

from importlib import import_module

from .case import CASES, Case
from .good import Good

FAMILIES = (
    "header", "texts", "attributes", "meaning", "sizes", "groups_v1", "headers_v1", "groups_v2", "messages_v2", "bombs",
    "archives",
    "checkpoints", "reuse", "found",
)  # fmt: skip
for family in FAMILIES:
    import_module(f".{family}", __name__)

__all__ = ["CASES", "FAMILIES", "Case", "Good"]
