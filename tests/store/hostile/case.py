"""One hostile file, what is right to do with it, and the list of all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from .good import Good

Right = Literal["refused", "accepted", "either"]
Build = Callable[[Good], bytes]


@dataclass(frozen=True)
class Case:
    """A file to be imported, or to lie in a store where an artifact should."""

    name: str
    right: Right  # what `verify` and `import` must do; "either" where both are harmless
    build: Build
    kind: str  # of the artifact
    form: Literal["artifact", "export", "checkpoint", "reuse"]

    @property
    def family(self) -> str:
        return self.name.partition(".")[0]


CASES: dict[str, Case] = {}


def case(right: Right = "refused", kind: str = "pretrain", form: str = "artifact") -> Callable[[Build], Build]:
    """Put a function among the cases, under the names of its module and its own."""

    def register(build: Build) -> Build:
        add(f"{build.__module__.rpartition('.')[2]}.{build.__name__}", build, right, kind, form)
        return build

    return register


def add(name: str, build: Build, right: Right = "refused", kind: str = "pretrain", form: str = "artifact") -> None:
    assert name not in CASES, name
    CASES[name] = Case(name, right, build, kind, form)  # type: ignore[arg-type]
