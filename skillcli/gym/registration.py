"""The ids of `gymnasium.make` and `gymnasium.make_vec`, and what their keywords mean."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from skillcli.composition.episodes import EpisodeSettings
from skillcli.errors import UsageError
from skillcli.evaluation.consistency import stored_recipe
from skillcli.gym.environments import GoalEnv, SkillEnv, SkillVectorEnv
from skillcli.gym.task_episodes import TaskEpisodes
from skillcli.kinds import COMPOSE
from skillcli.recipe import load_recipe, resolve
from skillcli.store import filled_store_at
from skillcli.tasks.registry import find_task, task_names
from skillcli.tasks.world import World

if TYPE_CHECKING:
    from skillcli.gym.latent_episodes import LatentEpisodes

NAMESPACE = "skill"
LATENT = f"{NAMESPACE}/Latent-v0"


def task_id(task: str, goal: bool = False) -> str:
    """Return the id of a task's environment: "reach" gives "skill/Reach-v0", goal-conditioned "skill/ReachGoal-v0"."""
    words = "".join(word.capitalize() for word in task.replace("_", "-").split("-"))
    return f"{NAMESPACE}/{words}{'Goal' if goal else ''}-v0"


def register_all() -> None:
    """Register every known task, plain and goal-conditioned, and `skill/Latent-v0`; call it again after adding a task.

    Gymnasium's checker of every step costs more than the physics, so it is off: `check_env` does the same once.
    """
    for task in task_names():
        for goal_conditioned in (False, True):
            _register(task_id(task, goal_conditioned), "make_task", {"task": task, "goal_conditioned": goal_conditioned})
    _register(LATENT, "make_latent", {})


def _register(name: str, maker: str, kwargs: dict[str, Any]) -> None:
    if name not in gymnasium.registry:
        entry = f"{__name__}:{maker}"
        gymnasium.register(name, entry, vector_entry_point=f"{entry}_vec", kwargs=kwargs, disable_env_checker=True)


def make_task(
    task: str,
    goal_conditioned: bool = False,
    recipe: str | None = None,
    robot: str | Path | None = None,
    settings: Sequence[str] = (),
    threads: int = 1,
) -> SkillEnv:
    """Make one environment of a task.

    Args:
        task: its name.
        goal_conditioned: whether observations are dictionaries with achieved and desired goal.
        recipe: a bundled recipe by name, or a TOML file, whose sections `task` and `robot` are taken; by default the task's
            own settings. What a recipe randomises in training is left out.
        robot: a bundled robot, or a robot file; by default one that can do the task.
        settings: KEY=VALUE settings, such as "task.horizon=100".
        threads: of the engine, 0 for all cores; results do not depend on it.

    Raises:
        UsageError: recipe, robot or a setting is invalid, or the recipe is of another task.
    """
    episodes = TaskEpisodes(world_of(task, recipe, robot, settings), 1, threads, goal_conditioned)
    return (GoalEnv if goal_conditioned else SkillEnv)(episodes)


def make_task_vec(
    task: str,
    goal_conditioned: bool = False,
    num_envs: int = 1,
    recipe: str | None = None,
    robot: str | Path | None = None,
    settings: Sequence[str] = (),
    threads: int = 0,
) -> SkillVectorEnv:
    """Make N environments of a task in one batch of the engine; see `make_task`."""
    return SkillVectorEnv(TaskEpisodes(world_of(task, recipe, robot, settings), num_envs, threads, goal_conditioned))


def make_latent(
    library: str | None = None,
    store: str | Path | None = None,
    segment: float | None = None,
    seconds: float | None = None,
    threads: int = 1,
) -> SkillEnv:
    """Make one environment whose actions are latents of a stored library.

    Args:
        library: id of an embed-means or pretrain artifact; the newest by default.
        store: its folder, as for `skillcli.load`.
        segment: how long one latent is held, s; by default as the recipe's section `ppo` has it, like all further settings.
        seconds: length of an episode, s.
        threads: of the engine, 0 for all cores.

    Raises:
        UsageError: a duration is out of range.
        StoreError: the library cannot be read.
    """
    return SkillEnv(_latent_episodes(library, store, segment, seconds, 1, threads))


def make_latent_vec(
    num_envs: int = 1,
    library: str | None = None,
    store: str | Path | None = None,
    segment: float | None = None,
    seconds: float | None = None,
    threads: int = 0,
) -> SkillVectorEnv:
    """Make N environments whose actions are latents, in one batch of the engine; see `make_latent`."""
    return SkillVectorEnv(_latent_episodes(library, store, segment, seconds, num_envs, threads))


def world_of(task: str, recipe: str | None, robot: str | Path | None, settings: Sequence[str]) -> World:
    """Return the world of a recipe, or of a task with its own settings.

    Raises:
        UsageError: recipe, robot or a setting is invalid, or the recipe is of another task.
    """
    which = None if robot is None else str(robot)
    if recipe is None:
        content: dict[str, Any] = {"name": task, "robot": which or find_task(task).robot, "task": {"name": task}}
        resolved = resolve(content, settings, by_hand=True)
    else:
        resolved = load_recipe(recipe, settings, which)
    if resolved.task.name != task:
        raise UsageError(
            f"the recipe {resolved.name} is of the {resolved.task.name} task, not of {task}", "give one of this task"
        )
    return World.of(resolved)


def _latent_episodes(
    library: str | None, store: str | Path | None, segment: float | None, seconds: float | None, num_envs: int, threads: int
) -> LatentEpisodes:
    from skillcli.evaluation.library import open_library  # torch, which the tasks do not need
    from skillcli.gym.latent_episodes import LatentEpisodes

    found = filled_store_at(store)
    artifact = found.read(found.resolve(library, COMPOSE.made_from))
    given = {"segment": segment, "seconds": seconds}
    chosen = [f"ppo.{key}={value}" for key, value in given.items() if value is not None]
    settings = stored_recipe(artifact, chosen).settings_of("ppo")
    assert isinstance(settings, EpisodeSettings)
    return LatentEpisodes(open_library(found, artifact), settings, num_envs, threads)
