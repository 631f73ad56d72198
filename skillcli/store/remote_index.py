"""What a shared store holds, told by the names of its files alone: two listings, whatever its size.

    objects/SHA256.h5                                  the file of an artifact, named by the hash of its bytes
    claims/NAME/STAGE-vN                               the content hash of the one artifact that may have this id
    index/NAME/STAGE-vN.TIME.CONTENT.SHA256.BYTES      an empty file: this artifact is here, and so are its ancestors

An artifact is visible once its file in `index` exists, which is written last and has no content that could be cut short.
None of it is believed: what is downloaded is compared with it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

from skillcli.errors import StoreError
from skillcli.store.artifact import Header
from skillcli.store.ids import NAME, ArtifactId, file_pattern
from skillcli.store.remote_files import Files
from skillcli.store.resolve import match

LAYOUT = "skill-store-1"
"""Folder of the present layout, below the address."""

_TIME = "%Y%m%dT%H%M%S%f"
_BEFORE = rf"{LAYOUT}/index/(?P<name>{NAME})/"
_AFTER = r"\.(?P<time>20[0-9]{6}T[0-9]{12})\.(?P<content>[0-9a-f]{64})\.(?P<sha256>[0-9a-f]{64})\.(?P<bytes>[1-9][0-9]{0,11})"


@dataclass(frozen=True)
class Entry:
    """One artifact of a shared store."""

    id: ArtifactId
    created_utc: str
    content_sha256: str
    sha256: str  # of the bytes of its file
    bytes: int

    @property
    def name(self) -> str:
        """Return the name of its file in the index."""
        time = datetime.fromisoformat(self.created_utc).strftime(_TIME)
        return f"{LAYOUT}/index/{self.id}.{time}.{self.content_sha256}.{self.sha256}.{self.bytes}"

    @property
    def object(self) -> str:
        """Return the name of the artifact's file."""
        return f"{LAYOUT}/objects/{self.sha256}.h5"

    @classmethod
    def of(cls, header: Header, artifact_id: ArtifactId, sha256: str, size: int) -> Entry:
        """Make the entry of an artifact under an id of the shared store."""
        return cls(artifact_id, header.created_utc, header.content_sha256, sha256, size)

    @classmethod
    def parse(cls, name: str) -> Entry | None:
        """Read a name; None if it is not one that this skill writes."""
        found = file_pattern(_BEFORE, _AFTER).fullmatch(name)
        if not found:
            return None
        try:
            made = datetime.strptime(found["time"], _TIME).replace(tzinfo=UTC)
        except ValueError:  # 30 February
            return None
        artifact_id = ArtifactId(found["name"], found["stage"], int(found["version"]))
        created = made.isoformat(timespec="microseconds")
        return cls(artifact_id, created, found["content"], found["sha256"], int(found["bytes"]))


def claim(artifact_id: ArtifactId) -> str:
    """Return the name of the file that gives an id to one content for ever."""
    return f"{LAYOUT}/claims/{artifact_id}"


class Catalog:
    """The artifacts of a shared store at one moment.

    Args:
        files: its files.
        names: those of the index.
        objects: those of artifacts.
    """

    def __init__(self, files: Files, names: Iterable[str], objects: Iterable[str]) -> None:
        self._address = files.address
        self._objects = set(objects)
        parsed = {name: Entry.parse(name) for name in names}
        self.strangers = sorted(name for name, entry in parsed.items() if entry is None)
        ordered = sorted(
            (entry for entry in parsed.values() if entry), key=lambda one: (one.id, one.content_sha256, one.sha256)
        )
        self._by_id: dict[ArtifactId, dict[str, Entry]] = {}
        for entry in ordered:  # the same run from two machines: the same content in different bytes
            known = self._by_id.setdefault(entry.id, {})
            if entry.content_sha256 not in known or not self.has_file(known[entry.content_sha256]):
                known[entry.content_sha256] = entry
        self._series: dict[str, list[ArtifactId]] = {}
        for artifact_id in self._by_id:
            self._series.setdefault(artifact_id.series, []).append(artifact_id)

    @classmethod
    def of(cls, files: Files) -> Catalog:
        """List a shared store."""
        return cls(files, files.names(f"{LAYOUT}/index"), files.names(f"{LAYOUT}/objects"))

    @property
    def entries(self) -> list[Entry]:
        """Return all artifacts, the newest last."""
        found = [entry for known in self._by_id.values() for entry in known.values()]
        return sorted(found, key=lambda one: (one.created_utc, one.id))

    def has_file(self, entry: Entry) -> bool:
        """Return whether the file of an artifact is there."""
        return entry.object in self._objects

    def has_object(self, name: str) -> bool:
        """Return whether a file of this name is there."""
        return name in self._objects

    def is_other(self, artifact_id: ArtifactId, content_sha256: str) -> bool:
        """Return whether an id belongs to other content."""
        return bool(self._by_id.get(artifact_id, {}).keys() - {content_sha256})

    def find(self, artifact_id: ArtifactId, content_sha256: str) -> Entry | None:
        """Find the artifact of a series with this content, under the given id if possible."""
        series = sorted(self._series.get(artifact_id.series, ()), key=lambda one: one != artifact_id)
        return next((entry for one in series if (entry := self._by_id[one].get(content_sha256))), None)

    def last_version(self, artifact_id: ArtifactId) -> int:
        """Return the highest version number of a series; 0 if there is none."""
        return max((one.version for one in self._series.get(artifact_id.series, ())), default=0)

    def pick(self, text: str) -> Entry:
        """Resolve what a user typed, as in a store.

        Raises:
            StoreError: it matches nothing or more than one, or the store is empty.
        """
        if not self._by_id:
            raise nothing_there(self._address)
        found = list(self._by_id[match(text, self._by_id)].values())
        if len(found) > 1:
            names = " and ".join(entry.content_sha256[:12] for entry in found)
            raise StoreError(
                f"{found[0].id} has more than one content at {self._address}: {names}",
                f"no skill did that: remove all but one from {LAYOUT}/index/{found[0].id.name} there",
            )
        return found[0]


def nothing_there(address: str) -> StoreError:
    """Make the error for an address without artifacts."""
    return StoreError(f"there are no artifacts at {address}", "check the address; `skill upload` puts some there")
