"""The mean latent of each skill, how well the skills are separated, and what each mean does."""

from __future__ import annotations

import numpy as np

from skillcli import metrics
from skillcli.envs.tasks import model_fingerprint
from skillcli.stages.library import fingerprint, open_library
from skillcli.stages.pretrain import play_held
from skillcli.store import Artifact, ArtifactId, Draft, Store


def inputs_of(source: Artifact) -> str:
    """Fingerprint of everything that the result depends on."""
    return fingerprint("embed-means", [source.content_sha256])


def embed_means(store: Store, source_id: ArtifactId, command: str, name: str | None = None) -> Artifact:
    """Play the mean latent of each skill of a pretrain artifact and write an embed-means artifact.

    Raises:
        StoreError: the source cannot be read, or the store refuses.
    """
    source = store.read(source_id)
    library = open_library(store, source)
    mean, std, recipe = library.mean, library.std, library.recipe
    skills = np.arange(len(mean))
    recording, _ = play_held(recipe, library.agent, mean, skills, skills)
    distance = metrics.final_distance(recording)
    return store.write(
        Draft(
            kind="embed-means",
            name=name or source_id.name,
            seed=source.seed,
            command=command,
            recipe=source.recipe,
            arrays={
                "embedding/mean": mean,
                "embedding/std": std,
                "embedding/bounds": np.stack([(mean - 2 * std).min(axis=0), (mean + 2 * std).max(axis=0)]),
                "embedding/latent_distance": metrics.pairwise_distance(mean),
                "embedding/goal_distance": metrics.pairwise_distance(library.goals),
                "skills/goal": library.goals,
                **{f"trajectories/{field}": array for field, array in recording.arrays().items()},
            },
            results={
                "skills": [
                    {
                        "name": skill,
                        "mean": mean[k].tolist(),
                        "std": std[k].tolist(),
                        "final_distance_m": float(distance[k]),
                    }
                    for k, skill in enumerate(library.names)
                ],
                "latent_goal_correlation": metrics.distance_correlation(mean, library.goals),
                "efficiency": metrics.embedding_efficiency(mean, std),
                "inference_accuracy": source.results["embedding"]["inference_accuracy"],
            },
            measured={},
            parents=[source_id],
            model_sha256=model_fingerprint(recipe.task),
            inputs_sha256=inputs_of(source),
        )
    )
