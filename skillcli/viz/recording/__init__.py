"""Record an artifact for rerun: arm, goals and paths in space, the path through the latent space, and time series.

Entities: `world` holds everything in space, `latent` the latent space, `series` what changes over control steps,
`learning` the learning curves, `provenance` the origin, and `episode` the facts about the playing episode. In a transfer
`source` shows the same episode in the simulation. The chosen episodes play one after another on the timelines `step` and
`sim_time`; learning has its own, `iteration`.

Only this package imports rerun.
"""

from __future__ import annotations

import uuid
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader

from skillcli.errors import SkillError
from skillcli.files import replacing
from skillcli.viz.meshes import Detail
from skillcli.viz.recording.clock import clocks
from skillcli.viz.recording.entities import slug
from skillcli.viz.recording.latent import log_means, log_moving
from skillcli.viz.recording.layout import blueprint
from skillcli.viz.recording.notes import log_card
from skillcli.viz.recording.series import log_curves, log_series
from skillcli.viz.recording.space import log_comparison, log_goals, log_model, log_paths
from skillcli.viz.scene import Scene, readable

LARGEST = 5_000_000  # bytes of a file: beyond, meshes are drawn more simply


def record(scene: Scene, path: Path) -> list[str]:
    """Write the scene as an .rrd file.

    Args:
        scene: what to show.
        path: the file to write; on failure nothing is left there.

    Returns:
        The entity paths in the file, sorted.

    Raises:
        SkillError: the file cannot be written, or does not read back.
    """
    with replacing(path) as (temporary,):
        return write(scene, temporary)


def write(scene: Scene, path: Path) -> list[str]:
    """Write like `record`, but in place.

    Raises:
        OSError: the disk refuses.
        SkillError: the file does not read back.
    """
    scene = readable(scene)
    has_meshes = any(model is not None and model.nmesh > 0 for model in (scene.model, scene.source_model))
    for detail in Detail if has_meshes else (Detail.FINE,):
        data = _encoded(scene, detail)
        if len(data) <= LARGEST:
            break
    path.write_bytes(data)
    return _entities(path)


def _encoded(scene: Scene, detail: Detail) -> bytes:
    """Return the content of the file."""
    stream = rr.RecordingStream(slug(f"skill-{scene.title}"), recording_id=uuid.uuid4())
    memory = stream.memory_recording()  # rerun itself hangs on a full disk, or gives no reason
    stream.send_blueprint(blueprint(scene), make_active=False)
    _log_all(stream, scene, detail)
    data: bytes = memory.drain_as_bytes()
    return data


def _entities(path: Path) -> list[str]:
    """List the entity paths of a finished file, which also checks that it can be read."""
    try:
        found = {chunk.entity_path for chunk in RrdReader(path).stream()}
    except (RuntimeError, ValueError) as error:
        raise SkillError(f"the recording does not read back: {error}", "is the disk full?") from error
    return sorted(entity for entity in found if not entity.startswith("/__"))


def _log_all(stream: rr.RecordingStream, scene: Scene, detail: Detail) -> None:
    stream.send_recording_name(scene.title)
    for root in ("world", "latent", *(["source"] if scene.source is not None else [])):
        stream.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    document = rr.TextDocument(scene.provenance, media_type=rr.MediaType.MARKDOWN)
    stream.log("provenance", document, static=True)
    log_goals(stream, scene)
    log_paths(stream, scene)
    log_means(stream, scene)
    log_curves(stream, scene)
    played = clocks(scene)
    if scene.model is not None and scene.trajectories.joint_position is not None:
        log_model(stream, scene, played, detail)
    for clock in played:
        log_moving(stream, scene, clock)
        log_series(stream, scene, clock)
        log_card(stream, scene, clock)
        log_comparison(stream, scene, clock)
