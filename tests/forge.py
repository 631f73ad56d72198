"""Artifacts as somebody who knows the format would write them: every hash is right, whatever they hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from skillcli.store import Artifact, ArtifactId, Store, codec, content_hash
from skillcli.store.canonical_json import sha256


def forge(store: Store, artifact: Artifact, **changes: Any) -> ArtifactId:
    """Write an artifact in place of itself, or under another `id`, with these parts of it changed and nothing checked."""
    changed = replace(artifact, **changes)
    changed = replace(changed, recipe_sha256=sha256(changed.recipe))
    changed = replace(changed, content_sha256=changes.get("content_sha256", content_hash(changed)))
    path = store.path(changed.id)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(codec.encode(changed))
    return changed.id
