"""A play: write what somebody recorded in `skill play` as an artifact."""

from __future__ import annotations

import numpy as np

from skillcli import metrics
from skillcli.composition.sequence import written
from skillcli.evaluation.library import Library
from skillcli.kinds import PLAY
from skillcli.kinds.play import PlayedRobot, PlayMeasured, PlayResults
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.viz.play.take import Take


def plan_of(artifact: Artifact, names: tuple[str, ...], period: float) -> str:
    """Return what was played as a plan for `compose --method sequence`; `names` are those of the skills, `period` is in s."""
    length = int(artifact.arrays["trajectories/length"][0])
    latent, skill = (artifact.arrays[f"trajectories/{name}"][0, :length] for name in ("latent", "skill"))
    return written(latent, skill, names, period)


def store_take(
    store: Store, source_id: ArtifactId, library: Library, take: Take, command: str, name: str | None = None, seed: int = 0
) -> Artifact:
    """Write one finished take.

    Args:
        store: to write to.
        source_id: the embed-means or pretrain artifact whose library was played.
        library: that library.
        take: what was recorded.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        seed: of random methods.

    Raises:
        StoreError: the store refuses.
    """
    recording, robot = take.recording, take.robot or library.world.robot
    target, path = recording.target, recording.achieved_goal[0]
    results = PlayResults(
        success=bool(recording.success[0]),
        failed=take.failed,
        final_distance_m=float(metrics.final_distance(recording)[0]),
        seconds=float(recording.time[-1]),
        violations={limit: int(steps.sum()) for limit, steps in recording.violation_steps.items() if steps.any()},
        robot=PlayedRobot(name=robot.name, fingerprint=robot.fingerprint),
    )
    return store.write(
        Draft(
            kind=PLAY.name,
            name=name or source_id.name,
            seed=seed,
            command=command,
            recipe=library.source.recipe,
            arrays={
                "play/goal": take.goal,
                **{f"play/{name}": values for name, values in take.knobs.items()},
                "waypoints/target": target,
                "waypoints/closest": np.linalg.norm(path - target, axis=1).min(keepdims=True),
                "waypoints/route": np.zeros(1, dtype=np.int64),
                **recording.stored(),
            },
            results=results.json(),
            measured=PlayMeasured(robot_file=None if take.robot is None else take.robot.which).json(),
            parents=[source_id],
            model_sha256=library.world.fingerprint,
        )
    )
