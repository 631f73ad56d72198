"""Stage 1: train policy and skill embedding together, evaluate every skill, and store everything."""

from __future__ import annotations

import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skillcli import metrics
from skillcli.config.randomization import sample
from skillcli.errors import Interrupted, StoreError
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.inputs import pretrain_inputs
from skillcli.evaluation.library import skill_names
from skillcli.evaluation.rollouts import rollout
from skillcli.kinds import PRETRAIN
from skillcli.kinds.outcome import Distances
from skillcli.kinds.pretrain import (
    EmbeddingQuality,
    ObservedTerm,
    PretrainMeasured,
    PretrainResults,
    Randomised,
    Throughput,
    TrainedRobot,
    TrainedSkill,
)
from skillcli.kinds.record import point
from skillcli.learning.agent import Agent
from skillcli.learning.learner import Learner
from skillcli.learning.saved import is_seconds, shown
from skillcli.progress import OnProgress, Progress, silent
from skillcli.recipe import Recipe
from skillcli.seeding import generator
from skillcli.simulation.throughput import BareEngine
from skillcli.stopping import StopRequest, stoppable
from skillcli.store import Artifact, Draft, Store, load_checkpoint, remove_checkpoint, save_checkpoint
from skillcli.tasks.world import MAX_SIMULATIONS, World
from skillcli.trajectories import Array, Trajectories

CHECKPOINT_SECONDS = 30.0
BARE_MEASUREMENTS = 30  # of the bare engine, spread over the run: both sides of the ratio see the same load


@dataclass(frozen=True)
class Evaluation:
    """Evaluated skills: row 0 of the samples is the mean latent, the others are drawn from p(z|t)."""

    latent: Array  # (K, 1+M, d)
    final_distance: Array  # (K, 1+M) m
    success: Array  # (K, 1+M) bool
    inferred: Array  # (K, 1+M, d), mean of q(z|window) at the end
    trajectories: Trajectories  # the first 1 + `stored` episodes of each skill


def pretrain(
    store: Store,
    recipe: Recipe,
    seed: int,
    name: str,
    command: str,
    resume: bool = False,
    threads: int = 0,
    on_progress: OnProgress = silent,
) -> Artifact:
    """Train the skills of a recipe and write a pretrain artifact.

    Args:
        store: to write to.
        recipe: what to train.
        seed: of everything random.
        name: first part of the new id.
        command: as typed, for the record.
        resume: continue from the checkpoint of the same recipe, seed and name; without one, start a new training.
        threads: of the engine, 0 for all cores; the result does not depend on it.
        on_progress: called with the progress of training.

    Raises:
        Interrupted: Ctrl-C; a checkpoint was kept.
        UsageError: a goal of the recipe cannot be reached, or an episode cannot start as it says.
        SkillError: training diverged, or the store refuses.
    """
    offset = recipe.randomisation.ranges.get("object_offset")
    drawn = (0.0, *offset.values) if offset else (0.0,)  # at first nothing is drawn
    world = World.of(recipe)
    world.check_start(min(drawn), max(drawn))
    for goal in world.goals:
        world.check_goal(goal)
    store.check_writable(name)
    inputs = pretrain_inputs(recipe, world, seed)
    checkpoint = store.checkpoint_path(name, PRETRAIN.name, inputs)
    with stoppable() as stop:
        delay = "latency" in recipe.randomisation.ranges
        env = world.make_env(recipe.training.simulations, threads, delay)
        learner, bare = Learner(env, recipe, seed), BareEngine(env)
        spent = _resumed(learner, checkpoint, inputs) if resume and checkpoint.exists() else 0.0
        started = time.perf_counter()

        def wall_seconds() -> float:  # of the whole training, without measuring the bare engine
            return spent + time.perf_counter() - started - bare.seconds

        def save() -> None:
            arrays, state = learner.state()
            save_checkpoint(checkpoint, arrays, {**state, "wall_seconds": wall_seconds(), "inputs_sha256": inputs})

        _train(learner, bare, recipe, on_progress, save, stop, command)
        wall = wall_seconds()
        save()  # evaluation and writing may be interrupted, or the disk may be full
        if stop.requested:
            raise _stopped("stopped after training, before evaluation; the state is saved", command)
    evaluation = evaluate(recipe, world, learner.agent, seed, threads)
    randomised = evaluate_randomised(recipe, world, learner.agent, seed, threads)
    artifact = store.write(_draft(recipe, world, seed, name, command, learner, evaluation, randomised, bare.rate, wall))
    remove_checkpoint(checkpoint)
    return artifact


def _resumed(learner: Learner, checkpoint: Path, inputs: str) -> float:
    """Load a checkpoint into a learner; return the seconds spent before it.

    Raises:
        StoreError: it cannot be read, or belongs to another training.
    """
    arrays, state = load_checkpoint(checkpoint)
    try:
        seconds, made_of = state.pop("wall_seconds", None), state.pop("inputs_sha256", None)
        if made_of != inputs:
            raise ValueError("it was made from another recipe or seed")
        if not is_seconds(seconds):
            raise ValueError(f"wall_seconds must be a duration, got {shown(seconds)}")
        learner.load(arrays, state)
    except ValueError as error:
        raise StoreError(
            f"the checkpoint {checkpoint} is not one of this training: {error}",
            "remove it, or start anew: `skill pretrain` without --resume",
        ) from error
    return float(seconds)


def _train(
    learner: Learner,
    bare: BareEngine,
    recipe: Recipe,
    on_progress: OnProgress,
    save: Callable[[], None],
    stop: StopRequest,
    command: str,
) -> None:
    names, total = skill_names(recipe), recipe.training.iterations
    every = max(1, total // BARE_MEASUREMENTS)
    saved = began = time.perf_counter()
    first_step = learner.env_steps
    while not learner.finished:
        if learner.iteration % every == 0:
            bare.watch()
        point = learner.iterate()
        bare.measure()
        seconds = time.perf_counter() - began - bare.seconds
        success = {name: point[f"success/{k + 1}"] for k, name in enumerate(names)}
        rate = (learner.env_steps - first_step) / seconds
        named = {f"success/{k + 1}": f"success/{name}" for k, name in enumerate(names)}
        scalars = {named.get(curve, curve): value for curve, value in point.items() if math.isfinite(value)}
        note = f"final distance {point['final_distance']:.3f} m"
        if "mixed/final_distance" in scalars:
            note += f", of mixtures {scalars['mixed/final_distance']:.3f} m"
        share = learner.env_steps / learner.sampling_seconds / bare.rate if bare.rate else None
        on_progress(Progress(PRETRAIN.name, learner.iteration, total, "iterations", rate, success, note, share, scalars))
        if stop.requested and not learner.finished:
            save()
            raise _stopped(f"stopped after iteration {learner.iteration} of {total}; the state is saved", command)
        if time.perf_counter() - saved > CHECKPOINT_SECONDS:
            save()
            saved = time.perf_counter()


def _stopped(message: str, command: str) -> Interrupted:
    resumed = command if "--resume" in command or " pretrain " not in f" {command} " else f"{command} --resume"
    return Interrupted(message, f"continue with: {resumed}")


def evaluate(recipe: Recipe, world: World, agent: Agent, seed: int, threads: int = 0) -> Evaluation:
    """Run the mean latent and sampled latents of every skill, deterministic, on the nominal robot."""
    samples = 1 + recipe.evaluation.latents
    mean, std = agent.embed()
    skills = len(mean)
    noise = generator(seed, "evaluation").standard_normal((skills, samples, mean.shape[1]))
    noise[:, 0] = 0.0
    latent = mean[:, None] + std[:, None] * noise
    skill = np.repeat(np.arange(skills), samples)
    latent_skill = np.where(np.arange(skills * samples) % samples == 0, skill, -1)  # -1: not the mean of any skill
    recording, observation = rollout_held(
        world, agent, latent.reshape(-1, mean.shape[1]), world.goals[skill], latent_skill, threads, start=skill
    )
    window = np.arange(observation.shape[1] - agent.window, observation.shape[1]).clip(min=0)  # padded as in training
    kept = [k * samples + m for k in range(skills) for m in range(min(samples, 1 + recipe.evaluation.stored))]
    shape = (skills, samples)
    return Evaluation(
        latent=latent,
        final_distance=metrics.final_distance(recording).reshape(shape),
        success=recording.success.reshape(shape),
        inferred=agent.infer(observation[:, window]).reshape(*shape, -1),
        trajectories=recording.select(kept),
    )


def evaluate_randomised(recipe: Recipe, world: World, agent: Agent, seed: int, threads: int = 0) -> Randomised | None:
    """Run the mean latents with everything varied that training varied, all at once; None if nothing was varied."""
    ranges = recipe.randomisation.ranges
    if not ranges:
        return None
    mean, _ = agent.embed()
    skill = np.tile(np.arange(len(mean)), 1 + recipe.evaluation.latents)
    rng = generator(seed, "evaluation on other robots")
    drawn, recordings = sample(ranges, len(skill), rng, world.joints), []
    for first in range(0, len(skill), MAX_SIMULATIONS):
        part = slice(first, first + MAX_SIMULATIONS)
        env = world.make_randomized_env(skill[part], {name: values[part] for name, values in drawn.items()}, rng, threads)
        latent, latent_skill = (np.repeat(each[part][:, None], env.horizon, axis=1) for each in (mean[skill], skill))
        recordings.append(rollout(env, agent.act, latent, latent_skill)[0])
    recording = Trajectories.join(recordings)
    successes = int(recording.success.sum())
    return Randomised(
        episodes=recording.episodes,
        success_rate=successes / recording.episodes,
        ci95=metrics.wilson_interval(successes, recording.episodes),
        final_distance_m=Distances(**metrics.distance_summary(metrics.final_distance(recording))),
    )


def _draft(
    recipe: Recipe,
    world: World,
    seed: int,
    name: str,
    command: str,
    learner: Learner,
    evaluation: Evaluation,
    randomised: Randomised | None,
    bare_rate: float | None,
    wall: float,
) -> Draft:
    mean, std = learner.agent.embed()
    goals = learner.env.goals
    curves = {f"curves/{curve}": np.array(values) for curve, values in learner.curves.items()}
    success = [curves.pop(f"curves/success/{k + 1}") for k in range(len(mean))]
    curves |= {f"curves/success/{skill}": curve for skill, curve in zip(skill_names(recipe), success, strict=True)}
    return Draft(
        kind=PRETRAIN.name,
        name=name,
        seed=seed,
        command=command,
        recipe=recipe.model_dump(mode="json"),
        arrays={
            **{f"weights/{path}": array for path, array in learner.agent.arrays().items()},
            **curves,
            "embedding/mean": mean,
            "embedding/std": std,
            "skills/goal": goals,
            "evaluation/latent": evaluation.latent,
            "evaluation/final_distance": evaluation.final_distance,
            "evaluation/inferred": evaluation.inferred,
            **evaluation.trajectories.stored(),
        },
        results=_results(recipe, world, learner, evaluation, randomised).json(),
        measured=PretrainMeasured(
            wall_seconds=wall, peak_memory_mb=peak_memory_mb(), throughput=_throughput(learner, bare_rate, wall)
        ).json(),
        model_sha256=world.fingerprint,
        inputs_sha256=pretrain_inputs(recipe, world, seed),
    )


def _results(
    recipe: Recipe, world: World, learner: Learner, evaluation: Evaluation, randomised: Randomised | None
) -> PretrainResults:
    mean, std = learner.agent.embed()
    goals, drawn = learner.env.goals, evaluation.success[:, 1:]
    at_means = np.arange(len(mean)) * (evaluation.trajectories.episodes // len(mean))
    turned = metrics.final_yaw(evaluation.trajectories.select(at_means))
    recognised = metrics.most_likely_skill(evaluation.inferred[:, 1:], mean, std) == np.arange(len(mean))[:, None]
    return PretrainResults(
        env_steps=learner.env_steps,
        success_rate=float(drawn.mean()),
        skills=tuple(
            TrainedSkill(
                name=name,
                goal=point(goals[k]),
                final_distance_m=float(evaluation.final_distance[k, 0]),
                success_rate=float(drawn[k].mean()),
                final_yaw_deg=None if turned is None else float(turned[k]),
            )
            for k, name in enumerate(skill_names(recipe))
        ),
        embedding=EmbeddingQuality(
            inference_accuracy=float(recognised.mean()),
            latent_goal_correlation=metrics.distance_correlation(mean, goals),
            efficiency=metrics.embedding_efficiency(mean, std),
        ),
        randomised=randomised,
        observation=tuple(ObservedTerm(name=term.name, unit=term.unit, size=term.size) for term in world.observation_terms),
        robot=_trained_robot(world),
    )


def _trained_robot(world: World) -> TrainedRobot | None:
    if not world.spec.uses_robot:
        return None
    robot = world.robot
    return TrainedRobot(name=robot.name, joints=robot.description.joints, fingerprint=robot.fingerprint)


def _throughput(learner: Learner, bare_rate: float | None, wall: float) -> Throughput:
    sampling = learner.env_steps / learner.sampling_seconds
    training = learner.env_steps / wall
    return Throughput(
        env_steps_per_second=training,
        sampling_env_steps_per_second=sampling,
        physics_limit_env_steps_per_second=bare_rate,
        sampling_ratio=sampling / bare_rate if bare_rate else None,
        training_ratio=training / bare_rate if bare_rate else None,
    )


def peak_memory_mb() -> float:
    """Return the largest resident size of this process so far, in 10^6 bytes."""
    unit = 1 if sys.platform == "darwin" else 1024  # macOS counts bytes, Linux kilobytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
