"""What the fuzzer found: seeds of changes that once ended in a signal, in much time, or in much memory."""

from __future__ import annotations

from collections.abc import Callable

from .case import add
from .good import Good
from .mutation import mutated

FOUND: dict[str, tuple[int, ...]] = {
    "present": (11, 140, 148, 182, 370, 454, 506, 515, 594, 669),
    "first": (162,),
}


def seeded(form: str, seed: int) -> Callable[[Good], bytes]:
    return lambda _: mutated(form, seed)


for form, seeds in FOUND.items():
    for seed in seeds:
        add(f"found.{form}_{seed}", seeded(form, seed))
