"""Load a `Scene` from the store, for figures and recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from skillcli.errors import SkillError, StoreError
from skillcli.evaluation.library import Library, is_same_robot, kin, open_library
from skillcli.kinds import COMPOSE, EMBED_MEANS, EXECUTION, PLAY, PRETRAIN, SWEEP, TRANSFER_EVAL, ByKind, kind_spec
from skillcli.kinds.transfer_eval import TargetRobot
from skillcli.robots.config import bundled_robots
from skillcli.robots.robot import load_target
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.tasks.world import World
from skillcli.trajectories import Array, Trajectories
from skillcli.viz.scene import Runs, Scene


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What a kind of artifact adds to its recording of E episodes; see `Scene`."""

    runs: Runs
    labels: tuple[str, ...]  # (E,)
    turn: Array | None = None  # (E,) index of each episode in its domain, from 0; None: there are no domains
    intervals: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    source: Trajectories | None = None
    other_robot: str = ""
    world: World | None = None  # that ran the episodes; None: the library's
    parameters: Mapping[str, Array] = field(default_factory=dict)
    pace: float = 1.0


SCENES: ByKind[Callable[[Store, Artifact, Library], Shown]] = ByKind("figure or recording")


def scene_of(store: Store, artifact_id: ArtifactId) -> Scene:
    """Load everything that can be drawn of an artifact.

    Raises:
        StoreError: it or its skills cannot be read, or its kind has no figure.
    """
    if artifact_id.stage == SWEEP.name:
        raise StoreError(
            f"{artifact_id} is a sweep: there is no recording of one", f"for a figure: `skill viz {artifact_id} --png FILE`"
        )
    artifact = store.read(artifact_id)
    show = SCENES.of(artifact.kind)
    library = open_library(store, artifact)
    recording = Trajectories(**artifact.group("trajectories"))
    task = library.recipe.task
    waypoints, waypoint_route, routes = _waypoints(store, artifact, library)
    shown = show(store, artifact, library)
    turn = np.arange(recording.episodes) if shown.turn is None else shown.turn
    world = shown.world or library.world
    return Scene(
        title=str(artifact.id),
        kind=artifact.kind,
        runs=shown.runs,
        task=task.name,
        figure_settings=library.world.spec.figure_settings,
        provenance=artifact.provenance(),
        trajectories=recording,
        model=world.model(),
        joints=world.robot.names.joints,
        fingers=world.robot.graspers().joints if world.spec.grasps else (),
        skills=library.names,
        goals=library.goals,
        waypoints=waypoints,
        waypoint_route=waypoint_route,
        episode_route=turn % routes,
        tolerance=task.tolerance,
        means=library.mean,
        stds=library.std,
        curves=artifact.group("curves"),
        map_places=artifact.arrays.get("map/place", np.zeros((0, 3))),
        map_ends=artifact.arrays.get("map/end", np.zeros((0, 3))),
        map_ends_on_robots=artifact.arrays.get("map/end_on_robots", np.zeros((0, 3))),
        episode_labels=shown.labels,
        intervals=shown.intervals,
        source=shown.source,
        episode_source=turn % (shown.source.episodes if shown.source else 1),
        source_model=library.world.model() if shown.world else None,
        source_joints=library.world.robot.names.joints if shown.world else (),
        other_robot=shown.other_robot,
        parameters=shown.parameters,
        pace=shown.pace,
    )


def _waypoints(store: Store, artifact: Artifact, library: Library) -> tuple[Array, Array, int]:
    """Return waypoints (W, 3) m of the plan that an artifact holds or was made from, their routes (W,), and the route count."""
    for candidate in (artifact.id, *store.lineage(artifact.id)):
        if kind_spec(candidate.stage).holds("waypoints"):
            arrays = kin(store, candidate, library).arrays
            route = arrays["waypoints/route"]
            return arrays["waypoints/target"], route, int(route.max()) + 1
    return np.zeros((0, 3)), np.zeros(0, dtype=int), 1


@SCENES.register(PRETRAIN)
def _trained(_store: Store, artifact: Artifact, library: Library) -> Shown:
    skills, episodes = library.names, len(artifact.arrays["trajectories/length"])
    each = episodes // len(skills)
    labels = (f"skill {skills[e // each]}" + (f", latent {e % each}" if e % each else "") for e in range(episodes))
    return Shown(runs=Runs.SAMPLED, labels=tuple(labels))


@SCENES.register(EMBED_MEANS)
def _embedded(_store: Store, artifact: Artifact, library: Library) -> Shown:
    between = (f"between {pair.from_} and {pair.to}" for pair in EMBED_MEANS.results_of(artifact).halfway)
    return Shown(runs=Runs.BETWEEN, labels=(*(f"skill {skill}" for skill in library.names), *between))


@SCENES.register(COMPOSE)
def _composed(_store: Store, artifact: Artifact, _library: Library) -> Shown:
    found = COMPOSE.results_of(artifact)
    routes = [f" {route + 1}" for route in range(found.routes)] if found.routes > 1 else [""]
    return Shown(runs=Runs.PLANNED, labels=tuple(f"{found.method} {found.task}{route}" for route in routes))


@SCENES.register(TRANSFER_EVAL)
def _transferred(store: Store, artifact: Artifact, library: Library) -> Shown:
    found, domain = TRANSFER_EVAL.results_of(artifact), artifact.arrays["episodes/domain"]
    names = [each.name for each in found.domains]
    turn = np.concatenate([np.arange(count) for count in np.bincount(domain, minlength=len(names))])
    return Shown(
        runs=Runs.DOMAINS,
        labels=tuple(f"{names[index]} {episode}" for index, episode in zip(domain, turn, strict=True)),
        turn=turn,
        intervals={each.name: (each.success_rate, *each.ci95) for each in found.domains},
        source=_sent(store, artifact, library),
        other_robot=found.robot.file if found.robot else "",
        world=_target(artifact, found.robot, library.world) if found.robot else None,
        parameters=_drawn(artifact, names),
    )


@SCENES.register(EXECUTION)
def _executed(store: Store, artifact: Artifact, library: Library) -> Shown:
    found, file = EXECUTION.results_of(artifact), EXECUTION.measured_of(artifact).robot_file
    arm = found.domain or found.driver
    other = f"{found.robot.name}.toml" if file else ""
    return Shown(
        runs=Runs.DOMAINS,
        labels=tuple(f"{arm} {episode}" for episode in range(found.episodes)),
        intervals={arm: (found.success_rate, *found.ci95)},
        source=_sent(store, artifact, library),
        other_robot=other,
        world=_other_world(artifact, file, other, found.robot.fingerprint, library.world) if file else None,
        pace=found.max_speed,
    )


@SCENES.register(PLAY)
def _played(_store: Store, artifact: Artifact, library: Library) -> Shown:
    found, file = PLAY.results_of(artifact), PLAY.measured_of(artifact).robot_file
    other = f"{found.robot.name}.toml" if file else ""
    return Shown(
        runs=Runs.PLANNED,
        labels=(f"played on {found.robot.name}" if library.world.spec.uses_robot else "played",),
        other_robot=other,
        world=_other_world(artifact, file, other, found.robot.fingerprint, library.world) if file else None,
    )


def _target(artifact: Artifact, robot: TargetRobot, world: World) -> World | None:
    """Return the robot that ran a transfer, in its world; None if its file is gone or has changed."""
    return _other_world(artifact, TRANSFER_EVAL.measured_of(artifact).robot_file or "", robot.file, robot.fingerprint, world)


def _other_world(artifact: Artifact, file: str, name: str, fingerprint: str, world: World) -> World | None:
    """Return the world of another robot than the source's; None if its file is gone or has changed.

    The artifact may come from elsewhere: only a file of the name that its results tell is read, by a whole path.
    """
    if file not in bundled_robots() and not (Path(file).is_absolute() and Path(file).name == name):
        return None
    try:
        target = load_target(file, world.robot)
        return world.on(target) if is_same_robot(artifact, fingerprint, target) else None
    except SkillError:
        return None


def _sent(store: Store, artifact: Artifact, library: Library) -> Trajectories:
    """Return the source's recording of what a transfer sent: each route of a plan, or each bare skill at its mean."""
    parent, skills = kin(store, artifact.parents[0].id, library), len(library.names)
    recording = Trajectories(**parent.group("trajectories"))
    spec = kind_spec(parent.kind)
    if spec.holds("plan"):
        return recording
    every = recording.episodes // skills if spec.holds("evaluation") else 1  # the mean is the first latent of each skill
    return recording.select(np.arange(skills) * every)


def _drawn(artifact: Artifact, names: list[str]) -> dict[str, Array]:
    """Return the parameters of each episode of a transfer, (E,) or (E, n) by name; NaN if a domain does not vary one."""
    found: dict[str, Array] = {}
    domain = artifact.arrays["episodes/domain"]
    for index, each in enumerate(names):
        for name, values in artifact.group(f"domains/{each}").items():
            found.setdefault(name, np.full((len(domain), *values.shape[1:]), np.nan))[domain == index] = values
    return found
