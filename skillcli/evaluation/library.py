"""A skill library from the store: the frozen agent, its recipe and its mean latents."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skillcli.errors import StoreError, UsageError
from skillcli.evaluation.consistency import (
    TRAINED,
    check_meaning,
    check_same_skills,
    skill_names,
    stored_recipe,
    trained_part,
)
from skillcli.kinds import PRETRAIN
from skillcli.learning.agent import Agent
from skillcli.recipe import Recipe
from skillcli.robots.config import is_path
from skillcli.robots.robot import Robot
from skillcli.simulation.settings import TaskSettings
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.store.provenance import package_versions
from skillcli.tasks.world import World
from skillcli.trajectories import Array

__all__ = [
    "TRAINED", "Library", "ancestor", "check_untouched", "fingerprint", "kin", "open_library", "skill_names",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Library:
    """Frozen skills."""

    source: Artifact  # the pretrain artifact
    recipe: Recipe
    world: World  # the task on the robot that the skills were trained on
    agent: Agent
    mean: Array  # (K, d)
    std: Array  # (K, d)
    goals: Array  # (K, 3) m

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the skills, as in the recipe."""
        return skill_names(self.recipe)

    def in_scene(self, task: TaskSettings) -> Library:
        """Return the same skills where there is what these settings of their task say, see `Recipe.in_scene`."""
        recipe = self.recipe.in_scene(task)
        return self if recipe is self.recipe else replace(self, recipe=recipe, world=replace(self.world, task=recipe.task))

    def judged_by(self, task: TaskSettings) -> Library:
        """Return the same skills in the same scene, judged as these settings of their task say, see `TaskSettings.JUDGED`."""
        judged = {key: getattr(task, key) for key in task.JUDGED}
        return self.in_scene(self.recipe.task.model_copy(update=judged))


def check_untouched(library: Library, recipe: Recipe, settable: str) -> None:
    """Refuse a recipe that would train other skills than these.

    Raises:
        UsageError: it differs from the library's recipe in a key that training depends on.
    """
    if recipe.fingerprint(TRAINED) != library.recipe.fingerprint(TRAINED):
        raise UsageError(
            f"the skills of {library.source.id} were trained on another recipe than the one given now",
            f"only {settable} can be set here; else train anew",
        )


def open_library(store: Store, artifact: Artifact) -> Library:
    """Open the library that an artifact holds or was made from, in the scene of the artifact.

    Raises:
        StoreError: it has no pretrain ancestor, one of the two disagrees with its recipe, or the robot file is missing or
            another one.
    """
    source = artifact if PRETRAIN.is_kind_of(artifact) else store.read(ancestor(store, artifact.id, PRETRAIN.name))
    for one in {source.id: source, artifact.id: artifact}.values():
        check_meaning(one)
    check_same_skills(artifact, source)
    recipe, weights = stored_recipe(source), source.group("weights")
    world = World.of(recipe)
    _check_robot(source, recipe.robot, world)
    observation, action, _ = world.sizes
    privileged = weights["privileged_normalizer.mean"].shape[0] if "privileged_normalizer.mean" in weights else 0
    agent = Agent(recipe, observation, action, source.arrays["skills/goal"], privileged=privileged)
    agent.load(weights)
    arrays = source.arrays
    library = Library(source, recipe, world, agent, arrays["embedding/mean"], arrays["embedding/std"], arrays["skills/goal"])
    return library.in_scene(trained_part(artifact).task)


def _check_robot(source: Artifact, robot: str, world: World) -> None:
    """Refuse the robot of a file that was changed since the training of `source`.

    Older trainings do not say which robot they had. Bundled robots change only with skill.
    """
    trained = PRETRAIN.results_of(source).robot
    if trained is not None and is_path(robot) and not is_same_robot(source, trained.fingerprint, world.robot):
        raise StoreError(
            f"{source.id} was trained on another robot than {robot} describes now: the file or its model was changed",
            "put both back as they were, and give the changed robot to transfer-eval by --robot; or train anew",
        )


def is_same_robot(artifact: Artifact, stored: str, robot: Robot) -> bool:
    """Return whether a robot is the one whose fingerprint an artifact holds, as far as that can be told.

    Another version of MuJoCo writes another text of the same model, so fingerprints of two versions cannot be compared.
    """
    return stored == robot.fingerprint or artifact.packages.get("mujoco") != package_versions()["mujoco"]


def kin(store: Store, artifact_id: ArtifactId, library: Library) -> Artifact:
    """Read an artifact that belongs to a library, in its migrated form if there is one.

    Raises:
        StoreError: it cannot be read, disagrees with its recipe, or was made with other skills.
    """
    found = store.read(store.current(artifact_id))
    check_meaning(found)
    check_same_skills(found, library.source)
    return found


def ancestor(store: Store, artifact_id: ArtifactId, kind: str) -> ArtifactId:
    """Return the nearest ancestor of a kind, in its migrated form if there is one.

    Raises:
        StoreError: there is none.
    """
    for candidate in store.lineage(artifact_id):
        if candidate.stage == kind:
            return store.current(candidate)
    raise StoreError(f"{artifact_id} has no {kind} among its ancestors", f"`skill show {artifact_id}` lists them")


def fingerprint(stage: str, parts: Iterable[Any]) -> str:
    """Hash everything that determines a stage's result with SHA-256, to recognise finished work."""
    return hashlib.sha256(json.dumps([stage, *parts], sort_keys=True, default=_plain).encode()).hexdigest()


def _plain(item: Any) -> Any:
    if isinstance(item, np.ndarray):
        return item.tolist()
    raise TypeError(f"cannot fingerprint {type(item).__name__}")
