"""The good files that hostile ones are made from: the shipped chain of the point."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from .forge import Forged, forge

SHIPPED = Path(__file__).parents[3] / "artifacts"
CHAIN = "reference-point"
NAME = "hostile"


@dataclass(frozen=True)
class Good:
    """Artifacts by kind."""

    root: Path = SHIPPED / CHAIN
    read: dict[str, bytes] = field(default_factory=dict)

    def data(self, kind: str = "pretrain") -> bytes:
        """The file of an artifact as it was stored."""
        return self.read.setdefault(kind, (self.root / f"{kind}-v1.h5").read_bytes())

    def forged(self, kind: str = "pretrain") -> Forged:
        """A copy to be changed, under a name of its own; its parents are those of the original."""
        copy = forge(self.data(kind))
        copy.header["id"] = f"{NAME}/{kind}-v1"
        return copy
