"""Train, load and evaluate: the functions of `import skillcli`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from skillcli.api import given
from skillcli.api.library import SkillLibrary
from skillcli.api.plan import ComposedPlan
from skillcli.errors import UsageError
from skillcli.progress import OnProgress, silent

if TYPE_CHECKING:
    from skillcli.kinds.transfer_eval import TransferEvalResults
    from skillcli.recipe import Recipe
    from skillcli.robots.robot import Robot
    from skillcli.store import Artifact, Store
    from skillcli.trajectories import Trajectories


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Episodes on robots that differ, made by `evaluate`.

    Attributes:
        artifact: that holds it.
    """

    artifact: Artifact

    @property
    def id(self) -> str:
        """Return its id in the store."""
        return str(self.artifact.id)

    @cached_property
    def results(self) -> TransferEvalResults:
        """Return everything that `skill transfer-eval --json` reports, typed."""
        from skillcli.kinds import TRANSFER_EVAL

        return TRANSFER_EVAL.results_of(self.artifact)

    @property
    def success_rate(self) -> dict[str, float]:
        """Return the share of successful episodes of each domain by name."""
        return {domain.name: domain.success_rate for domain in self.results.domains}

    @cached_property
    def trajectories(self) -> Trajectories:
        """Return all episodes, those of the first domain first."""
        from skillcli.trajectories import Trajectories

        return Trajectories(**self.artifact.group("trajectories"))


def load(artifact_id: str | None = None, store: Store | str | Path | None = None) -> SkillLibrary:
    """Load trained skills.

    Args:
        artifact_id: an embed-means or pretrain artifact: a full id, `NAME/STAGE` for its newest version, or a unique prefix;
            None for the newest one.
        store: a store or its folder; by default what SKILL_STORE names, else `artifacts` in the current folder.

    Raises:
        StoreError: there is no such store or artifact, or it is damaged.
    """
    from skillcli.kinds import COMPOSE
    from skillcli.store import filled_store_at

    found = filled_store_at(store)
    return SkillLibrary(found, found.read(found.resolve(artifact_id, COMPOSE.made_from)))


def train(
    recipe: str | Path | Recipe,
    *,
    settings: Sequence[str] = (),
    robot: str | Path | None = None,
    seed: int = 0,
    name: str | None = None,
    store: Store | str | Path | None = None,
    resume: bool = False,
    threads: int = 0,
    command: str = "",
    on_progress: OnProgress = silent,
) -> SkillLibrary:
    """Train the skills of a recipe and store them, as `skill pretrain` does.

    Args:
        recipe: a bundled one by name, the path of a TOML file, or a resolved one; then `settings` and `robot` cannot be given.
        settings: KEY=VALUE settings, such as "training.iterations=20".
        robot: a bundled robot, or a robot file, instead of the one that the recipe names.
        seed: of everything random; the same recipe and seed give the same content.
        name: first part of the new id; by default the recipe's name.
        store: to write to, see `load`.
        resume: continue a training of the same recipe, seed and name that was interrupted.
        threads: of the engine, 0 for all cores; the result does not depend on it.
        command: how to do it again, for the record; by default the call itself.
        on_progress: called with the progress of training.

    Raises:
        Interrupted: Ctrl-C; a checkpoint was kept, and `resume=True` continues.
        UsageError: the recipe is invalid, or a goal cannot be reached.
        StoreError: the store refuses.
    """
    from skillcli.recipe import load_recipe
    from skillcli.stages.pretrain import pretrain
    from skillcli.store import store_at

    target, named = store_at(store), isinstance(recipe, str | Path)
    if not named and (settings or robot is not None):
        raise UsageError("a resolved recipe takes neither settings nor a robot", "name the recipe instead")
    given_recipe = str(recipe) if isinstance(recipe, str | Path) else recipe.name
    again = given.call(
        "skillcli.train", given_recipe, settings=list(settings), robot=robot, seed=seed, name=name, resume=resume
    )
    resolved = (
        load_recipe(str(recipe), settings, None if robot is None else str(robot)) if isinstance(recipe, str | Path) else recipe
    )
    artifact = pretrain(target, resolved, seed, name or resolved.name, command or again, resume, threads, on_progress)
    return SkillLibrary(target, artifact)


def evaluate(
    what: str | SkillLibrary | ComposedPlan,
    domains: Sequence[str] = (),
    *,
    episodes: int | None = None,
    replan: bool = False,
    robot: str | Path | Robot | None = None,
    settings: Sequence[str] = (),
    sensitivity: bool = False,
    seed: int = 0,
    name: str | None = None,
    store: Store | str | Path | None = None,
    command: str = "",
    on_progress: OnProgress = silent,
) -> Evaluation:
    """Run a plan, or bare skills, on robots that differ from the simulation, and store what happened.

    Args:
        what: an id of the store, a library, or a plan, which is stored first.
        domains: presets by name, or TOML files; by default those of the recipe.
        episodes: of each domain; by default as in the recipe.
        replan: whether to measure the state after every segment and plan again from there.
        robot: another model of the same arm that runs the episodes.
        settings: KEY=VALUE settings of the transfer and of planning.
        sensitivity: whether to run every domain again with each of its parameters alone.
        seed: of the robots drawn; every plan meets the same ones.
        name: first part of the new id; by default that of the source.
        store: of an id, see `load`.
        command: how to do it again, for the record; by default the call itself.
        on_progress: called with the progress.

    Raises:
        UsageError: a domain or the robot is unknown, or there is no plan to plan again.
        StoreError: the source cannot be read, or the store refuses.
    """
    from skillcli.evaluation.consistency import stored_recipe
    from skillcli.kinds import TRANSFER_EVAL
    from skillcli.robots.robot import Robot, load_robot, load_target
    from skillcli.stages.transfer_eval import transfer_eval
    from skillcli.store import filled_store_at

    target = filled_store_at(store) if isinstance(what, str) else what.store
    text = what if isinstance(what, str) else what.save(name) if isinstance(what, ComposedPlan) else what.id
    source = target.resolve(text, TRANSFER_EVAL.made_from)
    recipe = stored_recipe(target.read(source), [*settings, *(["transfer.replan=true"] if replan else [])])
    other = robot if robot is None or isinstance(robot, Robot) else load_target(robot, load_robot(recipe.robot))
    wanted = list(dict.fromkeys(domains or recipe.transfer.domains))
    again = given.call(
        "skillcli.evaluate", str(source), wanted, episodes=episodes, replan=replan, settings=list(settings), seed=seed
    )
    count = recipe.transfer.episodes if episodes is None else given.at_least_one(episodes, "episodes")
    artifact = transfer_eval(
        target, source, recipe, wanted, count, seed, command or again, name, on_progress, other, sensitivity
    )
    return Evaluation(artifact)
