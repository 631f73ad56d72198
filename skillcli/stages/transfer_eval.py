"""Stage 3: run a composition, or the bare skills, on robots that differ from the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skillcli import metrics
from skillcli.composition.registry import replanning
from skillcli.evaluation.episode_schedule import EpisodeSchedule
from skillcli.evaluation.inputs import transfer_eval_inputs
from skillcli.evaluation.library import check_untouched, open_library
from skillcli.evaluation.replanning import Replanner, method_of
from skillcli.evaluation.transfer_evaluator import NOMINAL, TargetRobots, TransferEvaluator
from skillcli.evaluation.transfer_results import most_harmful_first, one_at_a_time, summarize_domain, summarize_source
from skillcli.kinds import TRANSFER_EVAL
from skillcli.kinds.transfer_eval import TargetRobot, TransferEvalMeasured, TransferEvalResults
from skillcli.progress import OnProgress, Progress, silent
from skillcli.recipe import Recipe
from skillcli.robots.robot import Robot
from skillcli.simulation.domains import find_domains
from skillcli.store import Artifact, ArtifactId, Draft, Store
from skillcli.trajectories import Trajectories


def transfer_eval(
    store: Store,
    source_id: ArtifactId,
    recipe: Recipe,
    domains: Sequence[str],
    episodes: int,
    seed: int,
    command: str,
    name: str | None = None,
    on_progress: OnProgress = silent,
    robot: Robot | None = None,
    sensitivity: bool = False,
) -> Artifact:
    """Run closed loop on target domains, with new parameters for every episode, and write a transfer-eval artifact.

    If all episodes of a domain are the same, one is run for each route or skill.

    Args:
        store: to read from and write to.
        source_id: a compose artifact, or embed-means or pretrain to evaluate bare skills.
        recipe: whether and how to plan again during an episode.
        domains: presets by name, or files.
        episodes: per random domain; more episodes begin with the same ones.
        seed: of the drawn parameters; every composition meets the same episodes.
        command: as typed, for the record.
        name: first part of the new id; by default that of the source.
        on_progress: called with the progress of the evaluation.
        robot: the model that runs the episodes, the source's by default; replanning simulates the source's.
        sensitivity: whether to run every domain again with each of its parameters alone.

    Raises:
        UsageError: a domain is unknown, two have the same name, the recipe asks for other skills than the source holds, the
            robot does not fit the task, or the source holds no plan that could be replanned.
        StoreError: the source cannot be read, or the store refuses.
    """
    found = find_domains(domains)
    store.check_writable(name or source_id.name)
    source = store.read(source_id)
    library = open_library(store, source).judged_by(recipe.task)
    drawn = [TargetRobots.drawn(domain, episodes, seed, library.world.joints) for domain in found]
    planning = ", ".join(f"{method}.*" for method in replanning())
    check_untouched(library, recipe, f"task.tolerance, transfer.*, compose.* and, with --replan, {planning}")
    replanner = Replanner(library, recipe, method_of(source)) if recipe.transfer.replan else None
    world = library.world if robot is None else library.world.on(robot)
    trial, once = TransferEvaluator(library, seed, world, replanner), EpisodeSchedule.of(source, library)
    trial.check()
    # nothing is random in the source: one episode of each route or skill is enough
    reference = TransferEvaluator(library, seed, library.world).run(once, NOMINAL)
    rate, rounds = float(reference.success.mean()), _Rounds(trial, once, on_progress)
    targets = [target.first(rounds.count(target)) for target in drawn]
    alone = {target.name: one_at_a_time(target) if sensitivity else {} for target in targets}
    rounds.expect([*targets, *(one for each in alone.values() for one in each.values())])
    recordings: list[Trajectories] = []
    errors, domain_results = [], []
    for target in targets:
        first = sum(recording.episodes for recording in recordings)
        recordings.append(rounds.play(target, target.name))
        errors.append(trial.replay(reference, target, target.episodes))
        alone_results = None
        if sensitivity:
            rows = {name: (one, rounds.play(one, f"{target.name}, {name} alone")) for name, one in alone[target.name].items()}
            alone_results = most_harmful_first(rows)
        domain_results.append(summarize_domain(target, recordings[-1], errors[-1], rate, first, alone_results))
    together = Trajectories.join(recordings)
    return store.write(
        Draft(
            kind=TRANSFER_EVAL.name,
            name=name or source_id.name,
            seed=seed,
            command=command,
            recipe=recipe.model_dump(mode="json"),
            arrays={
                **{f"domains/{target.name}/{each}": values for target in targets for each, values in target.parameters.items()},
                "episodes/domain": np.repeat(np.arange(len(targets)), [target.episodes for target in targets]),
                "episodes/final_distance": metrics.final_distance(together),
                "episodes/replay_error": np.concatenate(errors),
                "episodes/return": together.reward.sum(axis=1),
                **together.stored(),
            },
            results=TransferEvalResults(
                source=summarize_source(reference),
                domains=tuple(domain_results),
                robot=None if robot is None else TargetRobot.read({**robot.summary, "fingerprint": robot.fingerprint}),
                replanned=replanner is not None,
            ).json(),
            measured=TransferEvalMeasured(
                seconds_per_plan=None if replanner is None else replanner.effort.mean,
                robot_file=None if robot is None else robot.which,
            ).json(),
            parents=[source_id],
            model_sha256=library.world.fingerprint,
            inputs_sha256=transfer_eval_inputs(source, recipe, domains, episodes, seed, robot, sensitivity),
        )
    )


@dataclass
class _Rounds:
    """Runs episodes on one target after another, and counts them."""

    trial: TransferEvaluator
    once: EpisodeSchedule  # one episode of each route or skill
    on_progress: OnProgress
    total: int = 0
    done: int = 0
    success: dict[str, float] = field(default_factory=dict)  # by target, so far

    def count(self, target: TargetRobots) -> int:
        """Return how many of a target's episodes to run: equal ones run once."""
        return min(target.episodes, self.once.episodes) if target.repeats else target.episodes

    def expect(self, targets: Sequence[TargetRobots]) -> None:
        """Set the total number of episodes."""
        self.total = sum(self.count(target) for target in targets)

    def play(self, target: TargetRobots, what: str) -> Trajectories:
        """Run all episodes of a target."""
        before, count = self.done, self.count(target)

        def on_episode(episode: int, _: int) -> None:
            self.done = before + episode
            self._tell(f"{what}, episode {episode + 1} of {count}")

        self._tell(what)
        recording = self.trial.run(self.once.in_turn(count), target.first(count), on_episode)
        self.done = before + count
        if what == target.name:
            self.success[what] = float(recording.success.mean())
        self._tell(what)
        return recording

    def _tell(self, note: str) -> None:
        self.on_progress(Progress(TRANSFER_EVAL.name, self.done, self.total, "episodes", success=dict(self.success), note=note))
