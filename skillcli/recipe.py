"""Recipes: everything that determines a run, as frozen, bounded, described values.

A recipe is a TOML file. It may extend another one (`extends = "reach"`), and the command line can replace single values
(`--set training.iterations=20`). The result is validated here, once, and stored with every artifact.
"""

from __future__ import annotations

import copy
import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError, create_model, field_validator, model_validator

from skillcli.composition.method import MethodSettings
from skillcli.composition.registry import all_specs
from skillcli.config.base import Section, optional_value, value
from skillcli.config.explain import complaint, shown
from skillcli.config.randomization import RANGE_KEYS, Randomisation
from skillcli.config.toml_file import parse_toml, read_toml
from skillcli.errors import UsageError
from skillcli.learning.settings import Embedding, Mixtures, Network, Training
from skillcli.paths import LONGEST_PATH
from skillcli.robots.config import DEFAULT_ROBOT, bundled_robots, describe_robot, is_path, start_of
from skillcli.simulation.domains import find_domain
from skillcli.simulation.settings import TaskSettings
from skillcli.tasks.registry import find_task, load_task, ran_here, source_digest, task_names
from skillcli.tasks.spec import TaskSpec


class Evaluation(Section):
    """Settings of the evaluation of skills, always with deterministic actions on the nominal robot."""

    latents: int = value(100, "latents drawn from p(z|t) per skill", "", ge=1, le=10_000)
    stored: int = value(8, "of these, how many episodes per skill are kept as trajectories", "", ge=0, le=1000)


class Compose(Section):
    """Default request of a composition, and the robots that a plan must work on."""

    task: str = value("", "a named composition task, empty for none", "")
    goals: tuple[tuple[float, ...], ...] = value((), "goals in order, as --goal takes them, where no named task is given", "m")
    ensemble: int = value(
        0, "search and mpc score every latent on this many robots at once: the nominal one, and others drawn", "", ge=0, le=64
    )
    robots: str = value("real-like", "the domain that the others are drawn from", "")


class Transfer(Section):
    """Settings of the evaluation of a composition on other robots."""

    domains: tuple[str, ...] = value(("nominal", "mild", "real-like"), "target domains", "", min_length=1)
    episodes: int = value(50, "episodes per domain", "", ge=1, le=10_000)
    replan: bool = value(False, "look at the target after every segment, plan again from there and go on")
    replan_batch: int = value(4, "nodes that a search expands at once when it plans again", "nodes", ge=1, le=4096)
    replan_budget: int = value(40, "nodes after which it takes the best plan so far", "nodes", ge=1)
    replan_seconds: float = value(
        10.0, "a replanned episode has this long for each waypoint, and longer while it comes nearer", "s", gt=0, le=600
    )


DEEPEST = 8  # names in a key of --set; no recipe has so many


class _SkillsRecipe(Section):
    """The part of a recipe that determines the skills."""

    name: str = value(..., "the recipe's name", "")
    description: str = value("", "what this recipe is for, in one line", "")
    robot: str = optional_value(
        DEFAULT_ROBOT, "a bundled robot by its name, or the path of a robot file", "", max_length=LONGEST_PATH
    )
    task: TaskSettings = value(..., "what the skills are for", "")
    embedding: Embedding = Embedding()
    network: Network = Network()
    training: Training = Training()
    mixtures: Mixtures = optional_value(Mixtures(), "mixtures of skills that are trained too")
    randomisation: Randomisation = Randomisation()
    evaluation: Evaluation = Evaluation()

    @field_validator("name")
    @classmethod
    def _fit_for_an_id(cls, name: str) -> str:
        if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,63}", name):
            raise ValueError("expected 1 to 64 lower-case letters, digits and dashes, no dash in front")
        return name


# Methods whose section every recipe writes out. Others came later, and stored recipes stay the same without them.
_WRITTEN_OUT = ("search", "interpolate", "sequence", "ddpg", "ppo", "mpc")


def _section(method: str, settings: MethodSettings) -> Any:
    """The default of a recipe field that holds the section of a method."""
    return settings if method in _WRITTEN_OUT else optional_value(settings, f"settings of --method {method}")


if TYPE_CHECKING:
    _PlannedRecipe = _SkillsRecipe
else:  # one section for each method
    _PlannedRecipe = create_model(
        "_PlannedRecipe",
        __base__=_SkillsRecipe,
        __module__=__name__,
        **{name: (spec.settings, _section(name, spec.settings())) for name, spec in all_specs().items()},
    )


class Recipe(_PlannedRecipe):
    """A whole experiment, from training to transfer."""

    compose: Compose = Compose()
    transfer: Transfer = Transfer()

    @model_validator(mode="after")
    def _latents_fit_the_methods(self) -> Recipe:
        for name in all_specs():
            self.settings_of(name).check_latents(self.embedding.size)
        return self

    def settings_of(self, method: str) -> MethodSettings:
        """Return the section of a method."""
        settings: MethodSettings = getattr(self, method)
        return settings

    def in_scene(self, task: TaskSettings) -> Recipe:
        """Return the same recipe where there is what these settings of its task say, and judged as they say.

        See `TaskSettings.SCENE` and `TaskSettings.JUDGED`.
        """
        other = self.task.model_copy(update={key: getattr(task, key) for key in (*task.SCENE, *task.JUDGED)})
        return self if other == self.task else self.model_copy(update={"task": other})

    def fingerprint(self, sections: Iterable[str] = ()) -> str:
        """Hash the resolved values with SHA-256, of the named sections or of all."""
        content = self.model_dump(mode="json", include=set(sections) or None)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def recipe_folder() -> Path:
    """Return the folder of the bundled recipes: inside an installed package, beside it in a checkout."""
    inside = Path(__file__).parent / "recipes"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "recipes"


def recipe_names() -> list[str]:
    """List the names of the bundled recipes, sorted."""
    return sorted(path.stem for path in recipe_folder().glob("*.toml"))


def load_recipe(name: str, overrides: Iterable[str] = (), robot: str | None = None) -> Recipe:
    """Read a bundled recipe by name, or any TOML file by path, and apply `key=value` overrides.

    Args:
        name: of a recipe, or a path.
        overrides: such as `training.iterations=20`.
        robot: a bundled robot, or the path of a robot file; instead of the one that the recipe names.

    Raises:
        UsageError: unknown recipe, unreadable TOML, unknown key, or a value out of bounds.
    """
    content = _read(name, seen=())
    if robot is not None:
        content["robot"] = robot
    return resolve(content, overrides, by_hand=True)


def resolve(content: Mapping[str, Any], overrides: Iterable[str] = (), by_hand: bool = False) -> Recipe:
    """Validate a recipe's content after applying `a.b=value` overrides.

    Args:
        content: of a recipe file, or as an artifact stores it.
        overrides: such as `training.iterations=20`.
        by_hand: whether the user gave the recipe: then its task's Python file may run for the first time.

    Raises:
        UsageError: a key does not exist, or a value is out of bounds.
    """
    merged: dict[str, Any] = copy.deepcopy(dict(content))
    for override in overrides:
        merged = _merge(merged, _override(override))
    if by_hand:
        _randomise_as_a_domain(merged)
    kind = _recipe_for(_settings_of(merged, by_hand))
    try:
        return kind.model_validate(merged)
    except ValidationError as error:
        raise UsageError(*_explained(error, kind)) from error


def _randomise_as_a_domain(content: dict[str, Any]) -> None:
    """Put the distributions of a domain in place of its name or file: `randomisation`, or beside others its key `domain`."""
    given = content.get("randomisation")
    if isinstance(given, str):
        content["randomisation"] = Randomisation.sorted(find_domain(given).parameters)
    elif isinstance(given, Mapping) and isinstance(given.get("domain"), str):
        own = {key: item for key, item in given.items() if key != "domain"}
        content["randomisation"] = _merge(Randomisation.sorted(find_domain(given["domain"]).parameters), own)


def _settings_of(content: dict[str, Any], by_hand: bool) -> type[TaskSettings]:
    """Return the type of the section `task`; fill in what depends on the robot, such as the start."""
    given = content.get("task")
    if not isinstance(given, Mapping):
        return TaskSettings  # the validation reports the error
    robot = content.get("robot", DEFAULT_ROBOT)
    if "module" in given:
        given = content["task"] = _from_module(given, by_hand)
    name = given.get("name")
    if name is None:
        raise UsageError("recipe key 'task.name' is missing", f"tasks: {', '.join(task_names())}")
    if name not in task_names():
        known = ", ".join(map(repr, task_names()))
        raise UsageError(f"recipe key 'task.name': expected one of {known}, got {shown(name)}", "see `skill tasks`")
    spec = find_task(name)
    if spec.uses_robot and given.get("start"):
        _check_start(robot, given["start"])
    if spec.uses_robot and isinstance(robot, str):
        content["task"] = {**given, **_placed(spec, given, robot)}
    return spec.settings


def _placed(spec: TaskSpec, given: Mapping[str, Any], robot: str) -> dict[str, Any]:
    """Fill in the keys of the section `task` that depend on the robot: the start, and the place of the goals."""
    if spec.place is None or robot == DEFAULT_ROBOT:
        return {} if given.get("start") else {"start": start_of(robot, spec.name)}
    try:
        task = spec.settings.model_validate(dict(given))
    except ValidationError:
        return {}  # the validation of the whole recipe says what is wrong
    open_keys = [key for key in spec.placed if key not in given or (key == "start" and not given["start"])]
    if not open_keys:
        return {}
    from skillcli.robots.robot import load_robot  # compiles a model: slow to import

    placed = spec.place(task, load_robot(robot))
    return {key: placed[key] for key in open_keys}


def _from_module(task: Mapping[str, Any], by_hand: bool) -> dict[str, Any]:
    """Register the task of a Python file, and return the section `task` with its name and hash.

    A recipe from the user runs the file. A recipe from an artifact runs it only if the same file ran here before.
    """
    path, stored = task["module"], task.get("source_sha256", "")
    if not isinstance(path, str) or not 0 < len(path) <= LONGEST_PATH:
        raise UsageError(f"recipe key 'task.module': expected the path of a Python file, got {shown(path)}", "leave it out")
    digest = source_digest(Path(path))
    if stored and stored != digest:
        raise UsageError(
            f"task.module: {path} is not the file that these skills were trained on", "put that one back, or train anew"
        )
    if not by_hand and not ran_here(digest):
        raise UsageError(
            f"task.module: {path} never ran here, and an artifact alone does not run it",
            "read it; then let it run by giving its recipe: `skill recipes show RECIPE`",
        )
    spec = load_task(Path(path), digest)
    return {"name": spec.name, **task, "source_sha256": digest}


def _check_start(robot: str, start: Any) -> None:
    """Refuse a start whose length is not the joint count of a bundled robot; other robots are checked with their model."""
    if robot in bundled_robots() and isinstance(start, list | tuple):
        wanted = len(describe_robot(robot).joints)
        if len(start) != wanted:
            raise UsageError(
                f"recipe key 'task.start': expected {wanted} numbers, one for each joint, got {len(start)}",
                f"the {robot} has {wanted} joints; leave the key out for its own start",
            )


@cache
def _recipe_for(settings: type[TaskSettings]) -> type[Recipe]:
    """Make the type of a recipe for one task."""
    field = value(..., "what the skills are for", "")
    kind: type[Recipe] = create_model("Recipe", __base__=Recipe, __module__=__name__, task=(settings, field))
    return kind


def describe(recipe: Recipe) -> list[tuple[str, Any, str, str]]:
    """List every value of a recipe as (key, value, unit, description), in reading order."""
    rows: list[tuple[str, Any, str, str]] = []
    for key, field in type(recipe).model_fields.items():
        item = getattr(recipe, key)
        if isinstance(item, Section):
            rows += [
                (f"{key}.{sub}", _readable(getattr(item, sub)), _unit(info), info.description or "")
                for sub, info in type(item).model_fields.items()
            ]
        else:
            rows.append((key, item, _unit(field), field.description or ""))
    return rows


def _readable(item: Any) -> Any:
    return ", ".join(f"{name} {drawn}" for name, drawn in item.items()) if isinstance(item, dict) else item


def _unit(field: Any) -> str:
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def _read(name: str, seen: tuple[str, ...]) -> dict[str, Any]:
    path = Path(name) if name.endswith(".toml") else recipe_folder() / f"{name}.toml"
    if name in seen:
        raise UsageError(f"recipe {name!r} extends itself: {' -> '.join((*seen, name))}", "remove one `extends`")
    try:
        content = read_toml(path)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        known = ", ".join(recipe_names())
        raise UsageError(f"no recipe {name!r}", f"recipes: {known}; or give the path of a .toml file") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"recipe {name!r} cannot be read: {error}", "a recipe is a TOML file") from error
    _beside(content, path.parent)
    base = content.pop("extends", None)
    if base is None:
        return content
    if not isinstance(base, str):
        raise UsageError(f"recipe {name!r}: extends must be the name of a recipe, got {base!r}", 'extends = "reach"')
    beside = path.parent / base if base.endswith(".toml") else base
    return _merge(_read(str(beside), (*seen, name)), content)


def _beside(content: dict[str, Any], folder: Path) -> None:
    """Resolve files that a recipe names relative to its own folder."""
    robot, given = content.get("robot"), content.get("task")
    if isinstance(robot, str) and is_path(robot):
        content["robot"] = str(folder / robot)
    if isinstance(given, dict) and isinstance(path := given.get("module"), str) and path:
        given["module"] = str(folder / path)
    domain = content.get("randomisation")
    if isinstance(domain, str) and domain.endswith(".toml"):
        content["randomisation"] = str(folder / domain)
    elif isinstance(domain, dict) and isinstance(path := domain.get("domain"), str) and path.endswith(".toml"):
        domain["domain"] = str(folder / path)


def _merge(base: dict[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, item in change.items():
        old = merged.get(key)
        same_kind = isinstance(item, Mapping) and isinstance(old, dict) and item.get("name", old.get("name")) == old.get("name")
        same_kind = same_kind and isinstance(old, dict) and item.get("module", old.get("module")) == old.get("module")
        same_kind = same_kind and not item.keys() & RANGE_KEYS  # a range is one value
        merged[key] = _merge(old, item) if same_kind and isinstance(old, dict) else item
    return merged


def _override(text: str) -> dict[str, Any]:
    key, equals, raw = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > DEEPEST:
        raise UsageError(f"--set {shown(text)}: expected key=value", "for example --set training.iterations=20")
    item = parsed_value(key, raw)
    for part in reversed(parts):
        item = {part: item}
    return dict(item)


def parsed_value(key: str, raw: str) -> Any:
    """Read the value of `--set KEY=VALUE`: a TOML value, or a bare word as text.

    Raises:
        UsageError: it is neither.
    """
    try:
        return parse_toml(f"item = {raw}")["item"]
    except tomllib.TOMLDecodeError:
        return raw.strip()  # a bare word is a string: --set compose.task=triangle
    except ValueError as error:
        raise UsageError(f"--set {key}: {error}", "give a plain value") from None


def _explained(error: ValidationError, kind: type[Recipe]) -> tuple[str, str]:
    """Return one line and a hint for the first error."""
    found = complaint(error, kind)
    if found.kind == "unknown":
        return f"unknown recipe key {found.key!r}", f"keys here: {', '.join(sorted(found.known))}"
    if found.kind == "missing":
        return f"recipe key {found.key!r} is missing", "see `skill recipes show NAME`"
    label = f"recipe key {found.key!r}{found.entry}" if found.keys else "recipe"
    return f"{label}: {found.said}", "see `skill recipes show NAME` for units and meaning"
