"""The artifact store: `Store` keeps what stages hand over as a `Draft`, and gives it back as an `Artifact`."""

from __future__ import annotations

from skillcli.store.artifact import Artifact, Draft, Header, Parent, Unreadable, content_hash
from skillcli.store.checkpoint import load_checkpoint, remove_checkpoint, save_checkpoint
from skillcli.store.ids import STAGES, ArtifactId
from skillcli.store.schema import KINDS
from skillcli.store.store import Listing, Store

__all__ = [
    "KINDS",
    "STAGES",
    "Artifact",
    "ArtifactId",
    "Draft",
    "Header",
    "Listing",
    "Parent",
    "Store",
    "Unreadable",
    "content_hash",
    "load_checkpoint",
    "remove_checkpoint",
    "save_checkpoint",
]
