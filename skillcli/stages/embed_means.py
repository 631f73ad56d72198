"""Evaluate the mean latent of each skill and of pairs, the separation of skills, and the map from places to latents."""

from __future__ import annotations

import numpy as np

from skillcli import metrics
from skillcli.composition.latent_bounds import bounds_of
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.inputs import embed_means_inputs
from skillcli.evaluation.library import open_library
from skillcli.evaluation.map_quality import judge_map
from skillcli.kinds import EMBED_MEANS, PRETRAIN
from skillcli.kinds.embed_means import EmbedMeansResults, Halfway, MeanSkill
from skillcli.kinds.record import point
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Array, Trajectories


def embed_means(store: Store, source_id: ArtifactId, command: str, name: str | None = None) -> Artifact:
    """Run the mean latent of each skill of a pretrain artifact, and the mean of neighbouring ones; write embed-means.

    Neighbours have no other skill's goal between them. The first K trajectories are those of the skills. If mixtures of
    skills were trained, places between the goals are evaluated too.

    Raises:
        StoreError: the source cannot be read, or the store refuses.
    """
    source = store.read(source_id)
    library = open_library(store, source)
    mean, std = library.mean, library.std
    skills = np.arange(len(mean))
    pairs = np.array(metrics.neighbours(library.goals), dtype=int).reshape(-1, 2)
    latent = np.concatenate([mean, mean[pairs].mean(axis=1)])
    target = np.concatenate([library.goals, library.goals[pairs].mean(axis=1)])
    latent_skill = np.concatenate([skills, np.full(len(pairs), -1)])
    start = np.concatenate([skills, pairs[:, 0]])
    recording = rollout_held(library.world, library.agent, latent, target, latent_skill, start=start)[0]
    distance = metrics.final_distance(recording)
    judged = judge_map(library, source.seed) if library.recipe.mixtures.share else None
    return store.write(
        Draft(
            kind=EMBED_MEANS.name,
            name=name or source_id.name,
            seed=source.seed,
            command=command,
            recipe=source.recipe,
            arrays={
                "embedding/mean": mean,
                "embedding/std": std,
                "embedding/bounds": bounds_of(mean, std),
                "embedding/latent_distance": metrics.pairwise_distance(mean),
                "embedding/goal_distance": metrics.pairwise_distance(library.goals),
                "skills/goal": library.goals,
                "halfway/pair": pairs,
                **(judged.arrays() if judged else {}),
                **recording.stored(),
            },
            results=EmbedMeansResults(
                skills=tuple(
                    MeanSkill(
                        name=skill,
                        mean=tuple(mean[k].tolist()),
                        std=tuple(std[k].tolist()),
                        final_distance_m=float(distance[k]),
                    )
                    for k, skill in enumerate(library.names)
                ),
                halfway=_halfway(library.names, pairs, recording.select(slice(len(mean), None))),
                latent_goal_correlation=metrics.distance_correlation(mean, library.goals),
                efficiency=metrics.embedding_efficiency(mean, std),
                inference_accuracy=PRETRAIN.results_of(source).embedding.inference_accuracy,
                map=judged.quality if judged else None,
            ).json(),
            measured={},
            parents=[source_id],
            model_sha256=library.world.fingerprint,
            inputs_sha256=embed_means_inputs(source),
        )
    )


def _halfway(names: tuple[str, ...], pairs: Array, recording: Trajectories) -> tuple[Halfway, ...]:
    """Compare the mean of two neighbouring latents with the point half-way between the two goals."""
    episodes = np.arange(recording.episodes)
    start, end = recording.achieved_goal[:, 0], recording.achieved_goal[episodes, recording.length]
    moved, wanted = end - start, recording.target - start
    distance = metrics.final_distance(recording)
    lengths = np.linalg.norm(moved, axis=1), np.linalg.norm(wanted, axis=1)
    return tuple(
        Halfway(
            from_=names[a],
            to=names[b],
            final_distance_m=float(distance[i]),
            moved_m=point(moved[i]),
            direction_error_deg=metrics.angle_deg(moved[i], wanted[i]),
            magnitude_ratio=float(lengths[0][i] / lengths[1][i]) if lengths[1][i] > 0 else None,
        )
        for i, (a, b) in enumerate(pairs)
    )
