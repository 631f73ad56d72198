"""The artifact store: `Store` takes a `Draft` from a stage and returns an `Artifact`."""

from __future__ import annotations

from skillcli.store.archive import export, import_file
from skillcli.store.artifact import Artifact, Draft, Header, Parent, Unreadable, content_hash
from skillcli.store.checkpoint import load_checkpoint, remove_checkpoint, save_checkpoint
from skillcli.store.gc import Garbage, collect_garbage, find_garbage
from skillcli.store.ids import STAGES, ArtifactId
from skillcli.store.listing import Listing
from skillcli.store.lock import Owner, unlock
from skillcli.store.place import filled_store_at, store_at
from skillcli.store.receive import Imported
from skillcli.store.remote_download import download
from skillcli.store.remote_files import Files
from skillcli.store.remote_fsspec import open_remote
from skillcli.store.remote_upload import Transfer, upload
from skillcli.store.store import Store

__all__ = [
    "STAGES",
    "Artifact",
    "ArtifactId",
    "Draft",
    "Files",
    "Garbage",
    "Header",
    "Imported",
    "Listing",
    "Owner",
    "Parent",
    "Store",
    "Transfer",
    "Unreadable",
    "collect_garbage",
    "content_hash",
    "download",
    "export",
    "filled_store_at",
    "find_garbage",
    "import_file",
    "load_checkpoint",
    "open_remote",
    "remove_checkpoint",
    "save_checkpoint",
    "store_at",
    "unlock",
    "upload",
]
