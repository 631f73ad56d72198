"""Recipes: everything that determines a run, as frozen, bounded, described values.

A recipe is a TOML file. It may start from another one (`extends = "reach"`) and single values can be replaced on the
command line (`--set training.iterations=20`). What results is validated here, once, and stored with every artifact.
"""

from __future__ import annotations

import copy
import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from skillcli.composition.settings import Ddpg, Interpolate, Mpc, Ppo, Sequence
from skillcli.config.base import Section, value
from skillcli.config.explain import complaint, shown
from skillcli.config.randomization import RANGE_KEYS, Ranges
from skillcli.config.toml_file import parse_toml, read_toml
from skillcli.errors import UsageError

Vector3 = tuple[float, float, float]
Joints = tuple[float, float, float, float, float, float, float]


MAX_SKILLS = 1000  # every pair of them is looked at
MAX_LAYERS = 16


class SkillSet(Section):
    """What every task has: goals, one skill each, and their names."""

    goals: tuple[Any, ...]
    names: tuple[str, ...]

    @model_validator(mode="after")
    def _one_name_each(self) -> SkillSet:
        if len(set(self.goals)) != len(self.goals):
            raise ValueError("two skills have the same goal")
        if self.names and (len(self.names) != len(self.goals) or len(set(self.names)) != len(self.names)):
            raise ValueError(f"{len(self.goals)} goals need as many different names, got {list(self.names)}")
        if any(not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+=-]{0,31}", name) for name in self.names):
            raise ValueError("names start with a letter or digit and hold letters, digits and _ . + = -")
        return self


class PointTask(SkillSet):
    """A point in the plane that is moved by velocity; one skill per goal."""

    name: Literal["point"] = value("point", "which task", "")
    goals: tuple[tuple[float, float], ...] = value(
        ((0, 3), (3, 0), (0, -3), (-3, 0)), "where each skill should end", "m", min_length=1, max_length=MAX_SKILLS
    )
    names: tuple[str, ...] = value((), "names of the skills; numbers from 1 where there are none", "")
    tolerance: float = value(0.1414, "success radius: the diagonal of one step", "m", gt=0)
    horizon: int = value(50, "control steps in an episode", "steps", ge=2, le=10_000)
    step_limit: float = value(0.1, "largest move per axis and control step", "m", gt=0)
    control_period: float = value(0.05, "time between two commands; nominal, the point has no physics", "s", ge=1e-3, le=1)
    bound: float = value(5.0, "positions are clipped to this on either axis", "m", gt=0)


class ArmTask(SkillSet):
    """What every task of the Sawyer has: how an episode starts and how the arm is driven."""

    tolerance: float = value(0.05, "success radius", "m", gt=0)
    horizon: int = value(64, "control steps in an episode", "steps", ge=2, le=10_000)
    start: Joints = value(
        (-0.2791, -1.2418, 0.0126, 1.6544, -0.0044, 1.1583, 3.1016),
        "joint vector at reset: gripper at (.6, 0, .25), pointing down", "rad",
    )  # fmt: skip
    action_limit: float = value(0.04, "largest joint increment per control step", "rad", gt=0, le=0.2)
    control_period: float = value(0.05, "time between two commands", "s", ge=1e-3, le=1)
    timestep: float = value(0.005, "time step of the physics", "s", ge=1e-4, le=0.02)
    observe_command: bool = value(
        False, "the policy also sees how far its commanded joint target leads the measured joints: what is still under way"
    )

    @model_validator(mode="after")
    def _whole_substeps(self) -> ArmTask:
        substeps = self.control_period / self.timestep
        if abs(substeps - round(substeps)) > 1e-6 or round(substeps) < 1:
            raise ValueError(f"control_period {self.control_period} must be a whole number of timesteps {self.timestep}")
        return self


class ReachTask(ArmTask):
    """The Sawyer's gripper goes to a point in space; one skill per goal."""

    name: Literal["reach"] = value("reach", "which task", "")
    goals: tuple[Vector3, ...] = value(
        (
            (0.5, 0.3, 0.15), (0.5, -0.3, 0.15), (0.5, 0.3, 0.3), (0.5, -0.3, 0.3),
            (0.7, 0.3, 0.15), (0.7, -0.3, 0.15), (0.7, 0.3, 0.3), (0.7, -0.3, 0.3),
        ),
        "where the gripper of each skill should end, in the frame of the base", "m", min_length=1,
        max_length=MAX_SKILLS,
    )  # fmt: skip
    names: tuple[str, ...] = value((), "names of the skills; numbers from 1 where there are none", "")


class PushTask(ArmTask):
    """The Sawyer's finger pushes a box over the table; one skill per displacement."""

    name: Literal["push"] = value("push", "which task", "")
    goals: tuple[tuple[float, float], ...] = value(
        ((0.15, 0), (-0.15, 0), (0, 0.15), (0, -0.15)),
        "where the box of each skill should end, as seen from its nominal start", "m", min_length=1,
        max_length=MAX_SKILLS,
    )  # fmt: skip
    names: tuple[str, ...] = value(
        ("up", "down", "left", "right"), "names of the skills; numbers from 1 where there are none", ""
    )
    horizon: int = value(80, "control steps in an episode", "steps", ge=2, le=10_000)
    timestep: float = value(
        0.0025, "time step of the physics, which contact needs finer than free motion", "s", ge=1e-4, le=0.02
    )
    start: Joints = value(
        (-0.297, -1.0105, 0.0752, 1.6086, -0.0483, 0.9745, 3.016),
        "joint vector at reset: gripper 14 cm above the table at (.65, 0)", "rad",
    )  # fmt: skip
    box_start: tuple[float, float] = value((0.6, 0.0), "nominal start of the box on the table", "m")
    box_size: Vector3 = value((0.06, 0.06, 0.06), "full edges of the box", "m")
    box_mass: float = value(0.3, "of the box, evenly filled", "kg", gt=0, le=5)
    friction: float = value(0.6, "sliding friction between box and table, and box and finger", "", gt=0, le=3)
    observe_place: bool = value(
        False, "the policy also sees where on the table the box is, as joints and relative position together tell"
    )

    @model_validator(mode="before")
    @classmethod
    def _other_goals_have_no_names(cls, given: Any) -> Any:
        """The names that are the default belong to the goals that are."""
        return {"names": (), **given} if isinstance(given, Mapping) and "goals" in given else given

    @model_validator(mode="after")
    def _box_fits(self) -> PushTask:
        if any(not 0.01 <= edge <= 0.3 for edge in self.box_size):
            raise ValueError("every edge of the box must measure between 0.01 and 0.3 m")
        return self


Task = Annotated[PointTask | ReachTask | PushTask, Field(discriminator="name")]


class Embedding(Section):
    """The skill embedding p(z|t) and the inference network's view q(z|window)."""

    size: int = value(3, "dimensions of the latent space", "", ge=1, le=64)
    window: int = value(6, "observations that the inference network sees", "steps", ge=1, le=64)
    arrangement: Literal["goals", "random"] = value(
        "goals", "means start arranged as the goals are, which makes the latent space a map; or spread at random", ""
    )
    fixed_means: bool = value(False, "the means stay where they start; only the standard deviations are learned")
    initial_std: float = value(0.3, "standard deviation of p(z|t) at the start", "", gt=0)
    min_std: float = value(0.05, "lower bound of the standard deviation of p(z|t)", "", gt=0)
    max_std: float = value(0.5, "upper bound of the standard deviation of p(z|t)", "", gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> Embedding:
        if not self.min_std < self.initial_std < self.max_std:
            three = f"min_std {self.min_std:g}, initial_std {self.initial_std:g}, max_std {self.max_std:g}"
            raise ValueError(f"min_std < initial_std < max_std must hold, got {three}")
        return self


class Network(Section):
    """Sizes of the networks; all of them are tanh multilayer perceptrons."""

    policy_hidden: tuple[int, ...] = value((128, 128), "hidden layers of the policy", "units", max_length=MAX_LAYERS)
    linear_latent: bool = value(
        False, "the policy's mean is affine in the latent: between two latents it acts between the two, in every state"
    )
    value_hidden: tuple[int, ...] = value((128, 128), "hidden layers of the value function", "units", max_length=MAX_LAYERS)
    inference_hidden: tuple[int, ...] = value(
        (64, 64), "hidden layers of the inference network", "units", max_length=MAX_LAYERS
    )
    initial_action_std: float = value(0.6, "exploration at the start, in units of the action limit", "", ge=0.02, le=1)

    @model_validator(mode="after")
    def _positive(self) -> Network:
        if any(n < 1 or n > 4096 for n in (*self.policy_hidden, *self.value_hidden, *self.inference_hidden)):
            raise ValueError("every hidden layer needs between 1 and 4096 units")
        return self


class Training(Section):
    """TE-PPO: proximal policy optimisation of policy and embedding together."""

    simulations: int = value(256, "simulations side by side", "", ge=1, le=8192)
    iterations: int = value(60, "rollouts, each followed by one update", "", ge=1, le=1_000_000)
    chained_starts: float = value(
        0.7, "share of episodes that begin where an earlier rollout passed; the others begin at the start", "", ge=0, le=1
    )
    discount: float = value(0.99, "gamma", "1/step", ge=0, le=1)
    gae_lambda: float = value(0.95, "lambda of generalised advantage estimation", "", ge=0, le=1)
    epochs: int = value(5, "passes over each rollout", "", ge=1, le=100)
    minibatch: int = value(4096, "samples per gradient step", "samples", ge=1)
    clip: float = value(0.2, "clipping range of the policy ratio", "", gt=0, lt=1)
    learning_rate: float = value(1e-3, "step size at the start, and of value and inference", "", gt=0, le=1)
    target_kl: float = value(0.01, "the step size is adapted to this KL divergence per update", "nat", gt=0)
    settle_from: float = value(
        0.0, "share of the training from which on the target KL shrinks, linearly to a twentieth at the end", "", ge=0, le=1
    )
    final_action_std: float = value(
        1.0, "exploration at the end is at most this, in units of the action limit; comes down to it from settle_from on", "",
        ge=0.02, le=1,
    )  # fmt: skip
    max_grad_norm: float = value(0.5, "gradients are clipped to this norm", "", gt=0)
    reward_scale: float = value(5.0, "factor on the task's reward", "", gt=0)
    value_scale: float = value(10.0, "value targets are divided by this", "", gt=0)
    embedding_entropy: float = value(0.002, "alpha_1: weight of H{p(z|t)}", "", ge=0)
    inference_reward: float = value(0.02, "alpha_2: weight of log q(z|window) in the reward", "", ge=0)
    inference_clip: float = value(6.0, "log q(z|window) is clipped to plus and minus this", "nat", gt=0)
    policy_entropy: float = value(0.001, "alpha_3: weight of H{pi(a|s,z)}", "", ge=0)


Span = tuple[float, float]


class Randomisation(Section):
    """What differs from episode to episode while training (Tobin et al. 2017, Peng et al. 2018); nothing by default.

    Wide starts, latency and noise are slow to learn under from scratch. They reach a share of the simulations that grows
    over a span of the training.
    """

    dynamics: Ranges = value({}, "of the robot and the box, in every episode")
    starts: Ranges = value({}, "of where arm and box start, phased in over `starts_span`")
    sensing: Ranges = value({}, "of latency and sensors, phased in over `sensing_span`")
    starts_span: Span = value((0.05, 0.4), "shares of the training at which starts begin to vary, and vary everywhere", "")
    sensing_span: Span = value((0.5, 0.8), "shares of the training at which sensing begins to vary, and varies everywhere", "")

    @model_validator(mode="after")
    def _once_each(self) -> Randomisation:
        names = [*self.dynamics, *self.starts, *self.sensing]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{twice[0]} is named more than once")
        for span in (self.starts_span, self.sensing_span):
            if not 0 <= span[0] <= span[1] <= 1:
                raise ValueError(f"a span is two shares of the training in order, between 0 and 1, got {list(span)}")
        return self

    @property
    def ranges(self) -> Ranges:
        """All of them, by name."""
        return {**self.dynamics, **self.starts, **self.sensing}


class Evaluation(Section):
    """How skills are judged, always with deterministic actions on the nominal robot."""

    latents: int = value(100, "latents drawn from p(z|t) per skill", "", ge=1, le=10_000)
    stored: int = value(8, "of these, how many episodes per skill are kept as trajectories", "", ge=0, le=1000)


class Search(Section):
    """Uniform cost search over latents."""

    segments: tuple[float, ...] = value((0.25,), "how long one latent may be held", "s", min_length=1)
    interpolated: bool = value(False, "offer the half-way latents of all pairs of skills beside the means")
    grid: int = value(
        0,
        "offer a grid of this many latents per dimension, over the box of the means +- 2 std, beside the means",
        "",
        ge=0,
        le=32,
    )
    resolution: float = value(0.02, "two states closer than this count as one", "m", ge=1e-4, le=10)
    goal_tolerance: float = value(0.02, "a waypoint counts as met within this; the task's tolerance is the judge", "m", gt=0)
    max_speed: float = value(
        2.0, "no faster motion of the judged point is thought possible; gives the heuristic, 0 for none", "m/s", ge=0
    )
    approach_speed: float = value(
        0.0, "speed of the gripper on its way behind the box, for the heuristic of push; 0 leaves that out", "m/s", ge=0
    )
    weight: float = value(
        1.0, "weight of the heuristic: 0 uniform cost, 1 A*, above 1 faster to find, up to that much longer", "", ge=0
    )
    final_speed: float = value(0.0, "the last goal counts as met only at or below this speed; 0 for any", "m/s", ge=0)
    batch: int = value(32, "nodes that are expanded at once", "nodes", ge=1, le=4096)
    budget: int = value(5_000, "expanded nodes after which the best plan so far is taken", "nodes", ge=1)

    @model_validator(mode="after")
    def _positive(self) -> Search:
        if any(not 0 < s <= 60 for s in self.segments):
            raise ValueError("every segment must last between 0 and 60 seconds")
        return self


class Compose(Section):
    """What a composition is asked for when the command line does not say, and the robots that a plan has to hold on."""

    task: str = value("", "a named composition task, empty for none", "")
    goals: tuple[tuple[float, ...], ...] = value((), "goals in order, as --goal takes them, where no named task is given", "m")
    ensemble: int = value(
        0, "search and mpc score every latent on this many robots at once: the nominal one, and others drawn", "", ge=0, le=64
    )
    robots: str = value("real-like", "the domain that the others are drawn from", "")


class Transfer(Section):
    """How a composition is judged on other robots."""

    domains: tuple[str, ...] = value(("nominal", "mild", "real-like"), "target domains", "", min_length=1)
    episodes: int = value(50, "episodes per domain", "", ge=1, le=10_000)
    replan: bool = value(False, "look at the target after every segment, plan again from there and go on")
    replan_batch: int = value(4, "nodes that a search expands at once when it plans again", "nodes", ge=1, le=4096)
    replan_budget: int = value(40, "nodes after which it takes the best plan so far", "nodes", ge=1)
    replan_seconds: float = value(10.0, "a replanned episode may last this long, for each waypoint", "s", gt=0, le=600)


MAX_GRID = 1024  # latents on the grid of a search
DEEPEST = 8  # names in a key of --set; no recipe has so many


class Recipe(Section):
    """A whole experiment, from training to transfer."""

    name: str = value(..., "the recipe's name", "")
    description: str = value("", "what this recipe is for, in one line", "")
    task: Task = value(..., "what the skills are for", "")
    embedding: Embedding = Embedding()
    network: Network = Network()
    training: Training = Training()
    randomisation: Randomisation = Randomisation()
    evaluation: Evaluation = Evaluation()
    search: Search = Search()
    interpolate: Interpolate = Interpolate()
    sequence: Sequence = Sequence()
    ddpg: Ddpg = Ddpg()
    ppo: Ppo = Ppo()
    mpc: Mpc = Mpc()
    compose: Compose = Compose()
    transfer: Transfer = Transfer()

    @field_validator("name")
    @classmethod
    def _fit_for_an_id(cls, name: str) -> str:
        if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,63}", name):
            raise ValueError("expected 1 to 64 lower-case letters, digits and dashes, no dash in front")
        return name

    @model_validator(mode="after")
    def _grid_of_bounded_size(self) -> Recipe:
        if self.search.grid**self.embedding.size > MAX_GRID:
            raise ValueError(
                f"search.grid of {self.search.grid} gives {self.search.grid**self.embedding.size} latents in"
                f" {self.embedding.size} dimensions, at most {MAX_GRID} can be offered"
            )
        return self

    def fingerprint(self, sections: Iterable[str] = ()) -> str:
        """SHA-256 over the resolved values, of the named sections only where some are named."""
        content = self.model_dump(mode="json", include=set(sections) or None)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def recipe_folder() -> Path:
    """Where the shipped recipes lie: inside an installed package, beside it in a checkout."""
    inside = Path(__file__).parent / "recipes"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "recipes"


def recipe_names() -> list[str]:
    """Names of the shipped recipes, sorted."""
    return sorted(path.stem for path in recipe_folder().glob("*.toml"))


def load_recipe(name: str, overrides: Iterable[str] = ()) -> Recipe:
    """Read a shipped recipe by name, or any TOML file by path, and apply `key=value` overrides.

    Raises:
        UsageError: unknown recipe, unreadable TOML, unknown key, or a value out of bounds.
    """
    content = _read(name, seen=())
    return resolve(content, overrides)


def resolve(content: Mapping[str, Any], overrides: Iterable[str] = ()) -> Recipe:
    """Validate a recipe's content after applying `a.b=value` overrides.

    Raises:
        UsageError: a key that does not exist or a value that is out of bounds.
    """
    merged: dict[str, Any] = copy.deepcopy(dict(content))
    for override in overrides:
        merged = _merge(merged, _override(override))
    try:
        return Recipe.model_validate(merged)
    except ValidationError as error:
        raise UsageError(*_explained(error)) from error


def describe(recipe: Recipe) -> list[tuple[str, Any, str, str]]:
    """Every value of a recipe as (key, value, unit, description), in reading order."""
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
        raise UsageError(f"no recipe {name!r}", f"shipped recipes: {known}; or give the path of a .toml file") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"recipe {name!r} cannot be read: {error}", "a recipe is a TOML file") from error
    base = content.pop("extends", None)
    if base is None:
        return content
    if not isinstance(base, str):
        raise UsageError(f"recipe {name!r}: extends must be the name of a recipe, got {base!r}", 'extends = "reach"')
    beside = path.parent / base if base.endswith(".toml") else base
    return _merge(_read(str(beside), (*seen, name)), content)


def _merge(base: dict[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, item in change.items():
        old = merged.get(key)
        same_kind = isinstance(item, Mapping) and isinstance(old, dict) and item.get("name", old.get("name")) == old.get("name")
        same_kind = same_kind and not item.keys() & RANGE_KEYS  # a range is one value
        merged[key] = _merge(old, item) if same_kind and isinstance(old, dict) else item
    return merged


def _override(text: str) -> dict[str, Any]:
    key, equals, raw = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > DEEPEST:
        raise UsageError(f"--set {shown(text)}: expected key=value", "for example --set training.iterations=20")
    item: Any
    try:
        item = parse_toml(f"item = {raw}")["item"]
    except tomllib.TOMLDecodeError:
        item = raw.strip()  # a bare word is a string: --set compose.task=triangle
    except ValueError as error:
        raise UsageError(f"--set {key}: {error}", "give a plain value") from None
    for part in reversed(parts):
        item = {part: item}
    return dict(item)


def _explained(error: ValidationError) -> tuple[str, str]:
    """One line and a hint, for the first complaint."""
    found = complaint(error, Recipe)
    if found.kind == "unknown":
        return f"unknown recipe key {found.key!r}", f"keys here: {', '.join(sorted(found.known))}"
    if found.kind == "missing":
        return f"recipe key {found.key!r} is missing", "see `skill recipes show NAME`"
    label = f"recipe key {found.key!r}{found.entry}" if found.keys else "recipe"
    return f"{label}: {found.said}", "see `skill recipes show NAME` for units and meaning"
