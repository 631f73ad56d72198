"""What figures and the viewer need of an artifact, read from the store."""

from __future__ import annotations

import numpy as np

from skillcli.evaluation.library import Library, kin, open_library
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.trajectories import Array, Trajectories
from skillcli.viz.scene import Scene


def scene_of(store: Store, artifact_id: ArtifactId) -> Scene:
    """Everything there is to draw of an artifact.

    Raises:
        StoreError: it, or the skills it was made from, cannot be read.
    """
    artifact = store.read(artifact_id)
    library = open_library(store, artifact)
    recording = Trajectories(**artifact.group("trajectories"))
    task = library.recipe.task
    waypoints, waypoint_route, routes = _waypoints(store, artifact, library)
    turn = _turn(artifact, recording.episodes)
    source = _source(store, artifact, library)
    return Scene(
        title=str(artifact.id),
        kind=artifact.kind,
        task=task.name,
        drawing=library.world.spec.drawing,
        provenance=artifact.provenance(),
        trajectories=recording,
        model=library.world.model(),
        joints=library.world.robot.names.joints,
        skills=library.names,
        goals=library.goals,
        waypoints=waypoints,
        waypoint_route=waypoint_route,
        episode_route=turn % routes,
        tolerance=task.tolerance,
        means=library.mean,
        stds=library.std,
        curves=artifact.group("curves"),
        episode_labels=_labels(artifact, library.names, recording),
        intervals={domain["name"]: (domain["success_rate"], *domain["ci95"]) for domain in artifact.results.get("domains", [])},
        source=source,
        episode_source=turn % (source.episodes if source else 1),
        other_robot=(artifact.results.get("robot") or {}).get("file", ""),
        drawn=_drawn(artifact, recording.episodes),
    )


def _turn(artifact: Artifact, episodes: int) -> Array:
    """Which episode of its domain, or of the whole recording where there are none, each one is, (E,) from 0."""
    if artifact.kind != "transfer-eval":
        return np.arange(episodes)
    counts = np.bincount(artifact.arrays["episodes/domain"], minlength=len(artifact.results["domains"]))
    return np.concatenate([np.arange(count) for count in counts])


def _waypoints(store: Store, artifact: Artifact, library: Library) -> tuple[Array, Array, int]:
    """Waypoints (W, 3) m of the composition that an artifact is or was made from, their routes (W,), and how many routes."""
    for candidate in (artifact.id, *store.lineage(artifact.id)):
        if candidate.stage == "compose":
            arrays = kin(store, candidate, library).arrays
            route = arrays["waypoints/route"]
            return arrays["waypoints/target"], route, int(route.max()) + 1
    return np.zeros((0, 3)), np.zeros(0, dtype=int), 1


def _source(store: Store, artifact: Artifact, library: Library) -> Trajectories | None:
    """What a transfer sent, as the source recorded it: each route of a composition, or each bare skill at its mean."""
    if artifact.kind != "transfer-eval":
        return None
    parent, skills = kin(store, artifact.parents[0].id, library), len(library.names)
    recording = Trajectories(**parent.group("trajectories"))
    if parent.kind == "compose":
        return recording
    every = recording.episodes // skills if parent.kind == "pretrain" else 1  # the mean comes first of each skill's latents
    return recording.select(np.arange(skills) * every)


def _drawn(artifact: Artifact, episodes: int) -> dict[str, Array]:
    """Parameters drawn for each episode of a transfer, (E,) or (E, n) by name; NaN where a domain leaves one alone."""
    found: dict[str, Array] = {}
    for index, domain in enumerate(artifact.results.get("domains", [])):
        rows = artifact.arrays["episodes/domain"] == index
        for name, values in artifact.group(f"domains/{domain['name']}").items():
            found.setdefault(name, np.full((episodes, *values.shape[1:]), np.nan))[rows] = values
    return found


def _labels(artifact: Artifact, skills: tuple[str, ...], recording: Trajectories) -> tuple[str, ...]:
    if artifact.kind == "transfer-eval":
        names = [domain["name"] for domain in artifact.results["domains"]]
        index, turn = artifact.arrays["episodes/domain"], _turn(artifact, recording.episodes)
        return tuple(f"{names[domain]} {episode}" for domain, episode in zip(index, turn, strict=True))
    if artifact.kind == "compose":
        found = artifact.results
        routes = [f" {route + 1}" for route in range(found["routes"])] if found["routes"] > 1 else [""]
        return tuple(f"{found['method']} {found['task']}{route}" for route in routes)
    if artifact.kind == "embed-means":
        between = [f"between {pair['from']} and {pair['to']}" for pair in artifact.results["halfway"]]
        return (*(f"skill {skill}" for skill in skills), *between)
    each = recording.episodes // len(skills)
    return tuple(f"skill {skills[e // each]}" + (f", latent {e % each}" if e % each else "") for e in range(recording.episodes))
