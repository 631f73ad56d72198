"""Stage 3: run a composition, or the bare skills, on robots that differ from the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli import metrics
from skillcli.envs.domains import PARAMETERS, Domain, find_domain, sample
from skillcli.envs.tasks import MAX_SIMULATIONS, make, model_fingerprint
from skillcli.learning.playback import play, play_waypoints
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.stages.library import Library, fingerprint, open_library
from skillcli.stages.progress import Progress, Report, silent
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Array, Trajectories


@dataclass(frozen=True)
class Script:
    """What is fed to each episode: a composed plan, the same for all, or each skill's mean in turn."""

    latent: Array  # (E, T, d)
    skill: Array  # (E, T)
    start_skill: Array  # (E,) whose goal is the target, where there are no waypoints
    waypoints: Array  # (W, 3) m, (0, 3) for bare skills

    @staticmethod
    def of(source: Artifact, library: Library, episodes: int) -> Script:
        """The script of a compose artifact, or of the skills of any other kind."""
        if source.kind == "compose":
            trajectory = source.group("trajectories")
            latent, skill = (np.repeat(trajectory[name], episodes, axis=0) for name in ("latent", "skill"))
            return Script(latent, skill, np.zeros(episodes, dtype=np.int64), source.arrays["waypoints/target"])
        turn = np.arange(episodes) % len(library.mean)
        horizon = library.recipe.task.horizon
        latent = np.repeat(library.mean[turn][:, None], horizon, axis=1)
        return Script(latent, np.repeat(turn[:, None], horizon, axis=1), turn, np.zeros((0, 3)))


def inputs_of(source: Artifact, domains: Sequence[str], episodes: int, seed: int) -> str:
    """Fingerprint of everything that the result depends on."""
    tables = [[name, repr(find_domain(name).parameters)] for name in domains]
    return fingerprint("transfer-eval", [source.content_sha256, tables, episodes, seed])


def transfer_eval(
    store: Store,
    source_id: ArtifactId,
    recipe: Recipe,
    domains: Sequence[str],
    episodes: int,
    seed: int,
    command: str,
    name: str | None = None,
    report: Report = silent,
) -> Artifact:
    """Run closed loop on target domains, with parameters drawn anew per episode, and write a transfer-eval artifact.

    Args:
        store: where from and to.
        source_id: a compose artifact, or embed-means or pretrain to judge the bare skills.
        recipe: for the record.
        domains: names of presets.
        episodes: per domain.
        seed: of the drawn parameters; the same episodes for every composition.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        report: told where the evaluation stands.

    Raises:
        UsageError: a domain is unknown.
        StoreError: the source cannot be read, or the store refuses.
    """
    targets = [find_domain(domain) for domain in domains]
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library = open_library(store, source)
    distinct = 1 if source.kind == "compose" else len(library.mean)  # the source is deterministic: more would repeat
    reference, _ = run_on(library, Script.of(source, library, distinct), find_domain("nominal"), seed)
    recordings: list[Trajectories] = []
    parameters: dict[str, Array] = {}
    for done, target in enumerate(targets):
        report(Progress("transfer-eval", done, len(targets), "domains", note=target.name))
        recording, drawn = run_on(library, Script.of(source, library, episodes), target, seed)
        recordings.append(recording)
        parameters |= {f"domains/{target.name}/{parameter}": values for parameter, values in drawn.items()}
    together = Trajectories.join(recordings)
    return store.write(
        Draft(
            kind="transfer-eval",
            name=name or source_id.name,
            seed=seed,
            command=command,
            recipe=recipe.model_dump(mode="json"),
            arrays={
                **parameters,
                "episodes/domain": np.repeat(np.arange(len(targets)), episodes),
                "episodes/final_distance": metrics.final_distance(together),
                "episodes/return": together.reward.sum(axis=1),
                **{f"trajectories/{field}": array for field, array in together.arrays().items()},
            },
            results=_results(reference, targets, recordings),
            measured={},
            parents=[source_id],
            model_sha256=model_fingerprint(recipe.task),
            inputs_sha256=inputs_of(source, domains, episodes, seed),
        )
    )


def run_on(library: Library, script: Script, domain: Domain, seed: int) -> tuple[Trajectories, dict[str, Array]]:
    """Run a script on robots drawn from a domain; returns the recording and the drawn parameters by name."""
    episodes = len(script.start_skill)
    drawn = sample(domain, episodes, generator(seed, f"domain {domain.name}"))
    sensors = generator(seed, f"sensors {domain.name}")
    recordings = []
    for first in range(0, episodes, MAX_SIMULATIONS):
        part = slice(first, first + MAX_SIMULATIONS)
        recordings.append(_run(library, script, part, {name: values[part] for name, values in drawn.items()}, sensors))
    return Trajectories.join(recordings), drawn


def _run(
    library: Library, script: Script, part: slice, parameters: dict[str, Array], sensors: np.random.Generator
) -> Trajectories:
    env = make(library.recipe.task, len(script.start_skill[part]), delay="latency" in parameters)
    if parameters:
        env.perturb(parameters, sensors)
    env.reset(np.arange(env.num), script.start_skill[part])
    act, latent, skill = library.agent.act, script.latent[part], script.skill[part]
    if len(script.waypoints):
        return play_waypoints(env, act, latent, skill, script.waypoints)
    return play(env, act, latent, skill)[0]


def _results(reference: Trajectories, targets: list[Domain], recordings: list[Trajectories]) -> dict[str, Any]:
    rate = float(reference.success.mean())
    return {
        "source": {
            "success_rate": rate,
            "episodes": reference.episodes,
            "final_distance_m": float(metrics.final_distance(reference).mean()),
        },
        "domains": [_summary(target, recording, rate) for target, recording in zip(targets, recordings, strict=True)],
    }


def _summary(target: Domain, recording: Trajectories, source_rate: float) -> dict[str, Any]:
    successes, episodes = int(recording.success.sum()), recording.episodes
    distance = metrics.final_distance(recording)
    return {
        "name": target.name,
        "episodes": episodes,
        "successes": successes,
        "success_rate": successes / episodes,
        "ci95": list(metrics.wilson_interval(successes, episodes)),
        "final_distance_m": {
            "mean": float(distance.mean()),
            "median": float(np.median(distance)),
            "p90": float(np.quantile(distance, 0.9)),
        },
        "retention": successes / episodes / source_rate if source_rate > 0 else None,
        "parameters": {name: PARAMETERS[name][2] for name in target.parameters},
    }
