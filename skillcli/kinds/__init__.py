"""Kinds of artifacts, one module each; tables, figures and other parts elsewhere are registered with `ByKind`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

from skillcli.errors import StoreError
from skillcli.kinds.compose import COMPOSE
from skillcli.kinds.embed_means import EMBED_MEANS
from skillcli.kinds.execution import EXECUTION
from skillcli.kinds.play import PLAY
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.spec import KindSpec
from skillcli.kinds.sweep import SWEEP
from skillcli.kinds.transfer_eval import TRANSFER_EVAL

__all__ = [
    "COMPOSE",
    "EMBED_MEANS",
    "EXECUTION",
    "KINDS",
    "PLAY",
    "PRETRAIN",
    "RECORDED",
    "SWEEP",
    "TRANSFER_EVAL",
    "AnyKind",
    "ByKind",
    "KindSpec",
    "kind_spec",
]

AnyKind = KindSpec[Any, Any]
T = TypeVar("T")

KINDS: dict[str, AnyKind] = {
    spec.name: spec for spec in (PRETRAIN, EMBED_MEANS, COMPOSE, TRANSFER_EVAL, EXECUTION, PLAY, SWEEP)
}
"""By name, in the order of a chain."""

RECORDED = tuple(name for name, spec in KINDS.items() if spec.holds("trajectories"))
"""Kinds with trajectories."""


def kind_spec(kind: str, label: str = "it") -> AnyKind:
    """Return the spec of a kind; `label` names its artifact in the message.

    Raises:
        StoreError: there is no such kind.
    """
    if kind not in KINDS:
        raise StoreError(f"{label} is of an unknown kind, {kind!r}", f"this skill knows {', '.join(KINDS)}")
    return KINDS[kind]


class ByKind(Generic[T]):
    """A registry of something that some kinds have, outside this package, where the store cannot see it."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._known: dict[str, T] = {}

    def register(self, *specs: AnyKind) -> Callable[[T], T]:
        """Register the decorated object for these kinds."""

        def marked(found: T) -> T:
            self._known |= dict.fromkeys((spec.name for spec in specs), found)
            return found

        return marked

    def __contains__(self, kind: str) -> bool:
        """Return whether a kind is registered."""
        return kind in self._known

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the registered kinds."""
        return iter(self._known)

    def of(self, kind: str) -> T:
        """Return the object of a kind.

        Raises:
            StoreError: it has none.
        """
        if kind not in self._known:
            raise StoreError(f"there is no {self._what} of {kind}", f"there is one of {', '.join(self._known) or 'nothing'}")
        return self._known[kind]
