"""Show an artifact: a recording for the viewer, and a figure."""

from __future__ import annotations

from pathlib import Path

from skillcli.files import replacing
from skillcli.kinds import SWEEP
from skillcli.store import ArtifactId, Store
from skillcli.viz.loading import scene_of


def record(store: Store, artifact_id: ArtifactId, path: Path, picture: Path | None = None) -> list[str]:
    """Write a rerun recording of an artifact and, if asked for, a figure, both or none; return the recording's entities."""
    from skillcli.viz import recording  # rerun is slow to import

    scene = scene_of(store, artifact_id)
    if picture is None:
        return recording.record(scene, path)
    from skillcli.viz.figures import image

    with replacing(path, picture) as (unfinished, drawn):
        drawn.write_bytes(image(scene, picture))
        return recording.write(scene, unfinished)


def draw(store: Store, artifact_id: ArtifactId, path: Path) -> None:
    """Draw a figure of an artifact as PNG, PDF or SVG, by the suffix; of a sweep, its settings compared by the first metric."""
    if artifact_id.stage == SWEEP.name:
        _draw_sweep(store, artifact_id, path)
        return
    from skillcli.viz.figures import figure  # matplotlib is slow to import

    figure(scene_of(store, artifact_id), path)


def _draw_sweep(store: Store, artifact_id: ArtifactId, path: Path) -> None:
    from skillcli.evaluation.run_comparison import compare, learning_of
    from skillcli.evaluation.run_groups import groups_of
    from skillcli.viz.run_figure import write_figure

    groups = groups_of(store, [artifact_id])
    write_figure(compare(groups)[0], learning_of(store, groups), path)
