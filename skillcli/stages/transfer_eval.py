"""Stage 3: run a composition, or the bare skills, on robots that differ from the simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli import metrics
from skillcli.envs.domains import Domain, find_domain
from skillcli.envs.tasks import MAX_SIMULATIONS, make, model_fingerprint
from skillcli.errors import UsageError
from skillcli.learning.playback import play_waypoints
from skillcli.perturbation import PARAMETERS, sample
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.stages.library import Library, fingerprint, open_library
from skillcli.stages.planning import Leg
from skillcli.stages.progress import Progress, Report, silent
from skillcli.stages.replanning import REPLANS, Replanner
from skillcli.stages.robots import Robots
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Array, Trajectories


@dataclass(frozen=True)
class Script:
    """What is fed to each episode: the routes of a composed plan in turn, or each skill's mean in turn."""

    latent: Array  # (E, T, d)
    skill: Array  # (E, T)
    steps: Array  # (E,) control steps of each episode
    waypoints: tuple[Array, ...]  # (W, 3) m of each episode, the goal alone for bare skills

    @staticmethod
    def of(source: Artifact, library: Library, episodes: int | None = None) -> Script:
        """The script of a compose artifact, or of the skills of any other kind; one episode each where no number is given."""
        if source.kind == "compose":
            trajectory, route = source.group("trajectories"), source.arrays["waypoints/route"]
            latents, skills = trajectory["latent"], trajectory["skill"]
            period = library.recipe.task.control_period  # a route that failed in the source is sent whole all the same
            seconds = np.bincount(source.arrays["plan/route"], weights=source.arrays["plan/seconds"])
            steps = np.round(seconds / period).astype(np.int64)
            target = source.arrays["waypoints/target"]
            waypoints = [target[route == index] for index in range(len(latents))]
        else:
            horizon = library.recipe.task.horizon
            latents = np.repeat(library.mean[:, None], horizon, axis=1)
            skills = np.repeat(np.arange(len(library.mean))[:, None], horizon, axis=1)
            steps = np.full(len(latents), horizon)
            waypoints = [goal[None] for goal in library.goals]
        turn = np.arange(episodes or len(latents)) % len(latents)
        return Script(latents[turn], skills[turn], steps[turn], tuple(waypoints[index] for index in turn))


def inputs_of(source: Artifact, recipe: Recipe, domains: Sequence[str], episodes: int, seed: int) -> str:
    """Fingerprint of everything that the result depends on."""
    tables = [[name, str(sorted(find_domain(name).parameters.items()))] for name in domains]
    replanned = recipe.fingerprint(["transfer", "compose", *REPLANS]) if recipe.transfer.replan else ""
    return fingerprint("transfer-eval", [source.content_sha256, tables, episodes, seed, replanned])


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
        recipe: whether and how to plan again on the way.
        domains: names of presets.
        episodes: per domain.
        seed: of the drawn parameters; the same episodes for every composition.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        report: told where the evaluation stands.

    Raises:
        UsageError: a domain is unknown, or the source holds no plan that could be made again.
        StoreError: the source cannot be read, or the store refuses.
    """
    targets = [find_domain(domain) for domain in domains]
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library = open_library(store, source)
    replanner = _replanner(library, recipe, source, seed) if recipe.transfer.replan else None
    # the source is deterministic: one episode of each route or skill says it all
    reference, _ = run_on(library, Script.of(source, library), find_domain("nominal"), seed)
    recordings: list[Trajectories] = []
    parameters: dict[str, Array] = {}
    for done, target in enumerate(targets):
        report(Progress("transfer-eval", done, len(targets), "domains", note=target.name))
        script = Script.of(source, library, episodes)
        if replanner is None:
            recording, drawn = run_on(library, script, target, seed)
        else:
            recording, drawn = replan_on(library, script, target, seed, replanner, _within(report, target, done, len(targets)))
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
            results={**_results(reference, targets, recordings), "replanned": replanner is not None},
            measured={} if replanner is None else {"seconds_per_plan": replanner.effort.mean},
            parents=[source_id],
            model_sha256=model_fingerprint(recipe.task),
            inputs_sha256=inputs_of(source, recipe, domains, episodes, seed),
        )
    )


def _replanner(library: Library, recipe: Recipe, source: Artifact, seed: int) -> Replanner:
    if source.kind != "compose":
        raise UsageError(
            f"{source.id} holds no plan that could be made again on the way", "give a compose artifact, or leave --replan out"
        )
    leg = Leg(library, recipe, np.zeros((0, 3)), (), seed, silent, Robots())
    return Replanner(leg, source.results["method"])


def _within(report: Report, target: Domain, done: int, total: int) -> Callable[[int, int], None]:
    return lambda episode, episodes: report(
        Progress("transfer-eval", done, total, "domains", note=f"{target.name}, episode {episode} of {episodes}")
    )


def replan_on(
    library: Library, script: Script, domain: Domain, seed: int, replanner: Replanner, told: Callable[[int, int], None]
) -> tuple[Trajectories, dict[str, Array]]:
    """Like `run_on`, on the same robots, but the script only says where to go."""
    task, episodes = library.recipe.task, len(script.latent)
    drawn = sample(domain.parameters, episodes, generator(seed, f"domain {domain.name}"))
    target = make(task, 1, delay="latency" in drawn)
    steps = replanner.leg.steps(replanner.leg.recipe.transfer.replan_seconds)
    recordings = []
    for episode, waypoints in enumerate(script.waypoints):
        told(episode, episodes)
        if drawn:
            one = {name: values[episode : episode + 1] for name, values in drawn.items()}
            target.perturb(one, generator(seed, f"sensors {domain.name} {episode}"))
        target.reset(np.array([0]), np.array([0]))
        recordings.append(replanner.episode(target, waypoints, steps * len(waypoints), seed))
    return Trajectories.join(recordings), drawn


def run_on(library: Library, script: Script, domain: Domain, seed: int) -> tuple[Trajectories, dict[str, Array]]:
    """Run a script on robots drawn from a domain; returns the recording and the drawn parameters by name."""
    episodes = len(script.latent)
    drawn = sample(domain.parameters, episodes, generator(seed, f"domain {domain.name}"))
    sensors = generator(seed, f"sensors {domain.name}")
    recordings = []
    for first in range(0, episodes, MAX_SIMULATIONS):
        part = slice(first, first + MAX_SIMULATIONS)
        recordings.append(_run(library, script, part, {name: values[part] for name, values in drawn.items()}, sensors))
    return Trajectories.join(recordings), drawn


def _run(
    library: Library, script: Script, part: slice, parameters: dict[str, Array], sensors: np.random.Generator
) -> Trajectories:
    waypoints = script.waypoints[part]
    env = make(library.recipe.task, len(waypoints), delay="latency" in parameters)
    if parameters:
        env.perturb(parameters, sensors)
    env.reset(np.arange(env.num), np.zeros(env.num, dtype=np.int64))
    act, latent, skill = library.agent.act, script.latent[part], script.skill[part]
    return play_waypoints(env, act, latent, skill, waypoints, script.steps[part])


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
        "final_distance_m": metrics.distance_summary(distance),
        "retention": successes / episodes / source_rate if source_rate > 0 else None,
        "parameters": {name: PARAMETERS[name][2] for name in target.parameters},
    }
