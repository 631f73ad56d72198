"""Check that an artifact agrees with its own recipe: names and shapes of weights, goals, latents, clock, plan.

Only stored values and shapes are compared; no network is built, so a recipe that asks for huge networks costs nothing. The
store itself checks everything that needs no recipe, whenever it reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np

from skillcli.composition.plan import stored_steps
from skillcli.composition.registry import METHODS
from skillcli.config.randomization import PARAMETERS
from skillcli.errors import StoreError, UsageError
from skillcli.kinds import AnyKind, kind_spec
from skillcli.kinds.spec import Arrays, Results
from skillcli.learning.shapes import weight_shapes
from skillcli.paths import expanded
from skillcli.recipe import Recipe, resolve
from skillcli.robots.config import FEWEST, MOST, bundled_robots, describe_robot, is_path
from skillcli.store import Artifact
from skillcli.store.migrate import brought_up
from skillcli.store.schema import check_parents
from skillcli.tasks.registry import find_task
from skillcli.tasks.world import recorded, sizes, skill_goals

TRAINED = (
    "robot",
    "task",
    "embedding",
    "network",
    "training",
    "mixtures",
    "randomisation",
    "evaluation",
)  # recipe sections that training depends on

_CLOSE = 1e-5  # difference allowed between a stored 32-bit number and its recomputed value
_SHOWN = 3


def skill_names(recipe: Recipe) -> tuple[str, ...]:
    """Return the names of the recipe's skills; without names they are numbered from one, as in the paper."""
    return recipe.task.names or tuple(str(k + 1) for k in range(len(recipe.task.goals)))


def stored_recipe(artifact: Artifact, overrides: Iterable[str] = ()) -> Recipe:
    """Read the recipe of an artifact, with `a.b=value` overrides.

    Raises:
        StoreError: the stored recipe is invalid, or the robot file that it names is not there.
        UsageError: an override is invalid.
    """
    whole = _understood(artifact, artifact.recipe.keys())
    if is_path(whole.robot) and not expanded(whole.robot).exists():
        raise StoreError(
            f"{artifact.id} needs the robot file {whole.robot}, which is not there",
            "put it back; a path that does not begin with / starts in the folder where skill runs",
        )
    return resolve(artifact.recipe, overrides) if overrides else whole


def check_meaning(artifact: Artifact) -> None:
    """Refuse an artifact that disagrees with its recipe, or whose parents are of the wrong kind.

    Only the sections that training depends on are read. So plans and transfers of older versions stay valid, though their
    recipes may contain keys of their time.

    Raises:
        StoreError: they disagree.
    """
    check_parents(artifact.kind, [parent.id.stage for parent in artifact.parents], str(artifact.id))
    recipe = trained_part(artifact)
    arrays, results = brought_up(artifact)
    problems = list(islice(_problems(kind_spec(artifact.kind), recipe, arrays, results), _SHOWN))
    if problems:
        raise StoreError(
            f"{artifact.id} is not what its recipe says: {'; '.join(problems)}", "it was not made by skill: make it anew"
        )


def check_same_skills(artifact: Artifact, source: Artifact) -> None:
    """Refuse an artifact that was made with other skills than those of its source.

    Raises:
        StoreError: the skills differ.
    """
    if not are_same_skills(trained_part(artifact), trained_part(source)):
        raise StoreError(
            f"{artifact.id} was made with other skills than those of {source.id}", "it was not made by skill: make it anew"
        )


def trained_part(artifact: Artifact) -> Recipe:
    """Read the sections that training depends on; plans of older versions may have others that are not known any more.

    Raises:
        StoreError: they are invalid.
    """
    return _understood(artifact, ("name", *TRAINED))


def are_same_skills(one: Recipe, other: Recipe) -> bool:
    """Return whether two recipes train the same skills; what else is there in their scenes, and the judge, may differ."""
    return one.fingerprint(TRAINED) == other.in_scene(one.task).fingerprint(TRAINED)


def _understood(artifact: Artifact, sections: Iterable[str]) -> Recipe:
    wanted = set(sections)
    try:
        return resolve({key: item for key, item in artifact.recipe.items() if key in wanted})
    except UsageError as error:
        raise StoreError(
            f"the recipe stored in {artifact.id} is not one that this skill understands: {error.message}",
            "it was made by another version of skill, or not by skill: make it anew",
        ) from error


def _problems(spec: AnyKind, recipe: Recipe, arrays: Arrays, results: Results) -> Iterator[str]:
    """Check each group of arrays that the kind has."""
    if spec.holds("trajectories"):
        yield from _recording(recipe, arrays)
    if spec.holds("skills"):
        yield from _skills(recipe, arrays, results)
    if spec.holds("weights"):
        yield from _weights(recipe, arrays)
        yield from _curves(recipe, arrays)
    if spec.holds("evaluation"):
        yield from _evaluation(recipe, arrays)
    if spec.holds("plan"):
        yield from _plan(recipe, arrays, results)
    for path, array in arrays.items():
        if path.startswith("domains/"):
            yield from _parameter(path, array.shape[1:])


def _parameter(path: str, shape: tuple[int, ...]) -> Iterator[str]:
    """Check name and size of a domain's parameter; the arm that was driven may have more or fewer joints than the recipe's."""
    name = path.split("/")[2]
    if name not in PARAMETERS:
        yield f"a domain varies {name}, which is not a parameter"
        return
    size = PARAMETERS[name].size
    sizes = [size] if size else range(FEWEST, MOST + 1)
    if shape not in [() if each == 1 else (each,) for each in sizes]:
        wanted = f"{size}" if size else "one for each joint"
        yield f"{path} has {shape} values in each episode, expected {wanted}"


def _recording(recipe: Recipe, arrays: Arrays) -> Iterator[str]:
    """Check latents, skills, actions, clock and positions."""
    task, skill = recipe.task, arrays["trajectories/skill"]
    joints = _joints(recipe, arrays)
    _, action, _ = sizes(task, joints)
    steps, places = skill.shape[1], recorded(task, joints)
    wanted = {
        "latent": (*skill.shape, recipe.embedding.size),
        "action": (*skill.shape, action),
        **{field: (len(skill), steps + 1, size) for field, size in places.items()},
    }
    if "trajectories/other_poses" in arrays:  # recordings of before have none
        wanted["other_poses"] = (len(skill), steps + 1, 7 * len(getattr(task, "others", ())))
    for field, shape in wanted.items():
        found = arrays.get(f"trajectories/{field}")
        if found is None or found.shape != shape:
            yield f"trajectories/{field} has {'nothing' if found is None else f'shape {found.shape}'}, expected {shape}"
    if skill.max() >= len(task.goals):
        yield f"trajectories/skill names skill {skill.max()}, there are {len(task.goals)}"
    if not np.allclose(np.diff(arrays["trajectories/time"]), task.control_period, rtol=1e-6):
        yield f"trajectories/time does not advance by {task.control_period} s"
    if {path.removeprefix("trajectories/") for path in arrays} & _PLACES != set(places):
        yield f"its positions are not those of the {task.name} task"


_PLACES = {"position", "gripper_position", "object_pose", "joint_position", "finger_position"}


def _joints(recipe: Recipe, arrays: Arrays) -> int:
    """Return the joint count; if the robot's file is not bundled, the number of joints that moved."""
    if recipe.robot in bundled_robots():
        return len(describe_robot(recipe.robot).joints)
    return int(arrays["trajectories/action"].shape[-1]) - find_task(recipe.task.name).grasps


def _skills(recipe: Recipe, arrays: Arrays, results: Results) -> Iterator[str]:
    """Check the skills; their latents are held from start to end of an episode."""
    steps = arrays["trajectories/skill"].shape[1]
    if steps != recipe.task.horizon:
        yield f"its episodes have {steps} control steps, its recipe {recipe.task.horizon}"
    goals, shape = skill_goals(recipe.task), (len(recipe.task.goals), recipe.embedding.size)
    if arrays["embedding/mean"].shape != shape:
        yield f"embedding/mean has shape {arrays['embedding/mean'].shape}, expected {shape}"
    elif not np.allclose(arrays["skills/goal"], goals, atol=1e-9):
        yield "skills/goal holds other goals"
    if tuple(skill["name"] for skill in results["skills"]) != skill_names(recipe):
        yield "results.skills names other skills"


def _weights(recipe: Recipe, arrays: Arrays) -> Iterator[str]:
    """Check name, type and shape of every weight, and the embedding that the weights encode."""
    observation, action, _ = sizes(recipe.task, _joints(recipe, arrays))
    found = {path.removeprefix("weights/"): array for path, array in arrays.items() if path.startswith("weights/")}
    extra = found.get("privileged_normalizer.mean")
    privileged = 0 if extra is None or extra.ndim != 1 else len(extra)  # the check of shapes refuses another rank
    wanted = weight_shapes(recipe, observation, action, privileged)
    for name in sorted(wanted.keys() ^ found.keys()):
        yield f"weights/{name} is {'missing' if name in wanted else 'none of its networks'}"
    different = [name for name in wanted if name in found and found[name].shape != wanted[name]]
    for name in different:
        yield f"weights/{name} has shape {found[name].shape}, expected {wanted[name]}"
    for name, array in found.items():
        if array.dtype != np.float32:
            yield f"weights/{name} holds {array.dtype}, expected float32"
        elif name.endswith((".variance", ".count")) and (array < 0).any():
            yield f"weights/{name} is negative"
    if not different and wanted.keys() <= found.keys():
        yield from _embedding(recipe, arrays)


def _curves(recipe: Recipe, arrays: Arrays) -> Iterator[str]:
    for path, array in arrays.items():
        if path.startswith("curves/") and len(array) > recipe.training.iterations:
            yield f"{path} has {len(array)} points, the training {recipe.training.iterations} iterations"


def _embedding(recipe: Recipe, arrays: Arrays) -> Iterator[str]:
    low, high = recipe.embedding.min_std, recipe.embedding.max_std
    mean = np.tanh(arrays["weights/embedding.raw_mean"])
    with np.errstate(over="ignore"):
        std = low + (high - low) / (1.0 + np.exp(-arrays["weights/embedding.raw_std"].astype(float)))
    for path, meant in (("embedding/mean", mean), ("embedding/std", std)):
        if arrays[path].shape == meant.shape and not np.allclose(arrays[path], meant, atol=_CLOSE):
            yield f"{path} is not what its weights say"


def _evaluation(recipe: Recipe, arrays: Arrays) -> Iterator[str]:
    samples, skills = 1 + recipe.evaluation.latents, len(recipe.task.goals)
    shape, kept = (skills, samples), skills * min(samples, 1 + recipe.evaluation.stored)
    if arrays["evaluation/final_distance"].shape != shape:
        yield f"evaluation/final_distance has shape {arrays['evaluation/final_distance'].shape}, expected {shape}"
    if len(arrays["trajectories/length"]) != kept:
        yield f"it keeps {len(arrays['trajectories/length'])} episodes, expected {kept}"


def _plan(recipe: Recipe, arrays: Arrays, results: Results) -> Iterator[str]:
    skills = len(recipe.task.goals)
    if results["method"] not in METHODS:
        yield f"results.method must be one of {', '.join(METHODS)}"
    if arrays["plan/latent"].shape[1:] != (recipe.embedding.size,) or arrays["plan/skill"].max() >= skills:
        yield f"plan/latent and plan/skill are not those of {skills} skills in {recipe.embedding.size} dimensions"
    if "calibration/pair" in arrays and arrays["calibration/pair"].max(initial=0) >= skills:
        yield f"calibration/pair names a skill that is none of {skills}"
    steps = stored_steps(arrays, recipe.task.control_period)
    if steps.max() != arrays["trajectories/skill"].shape[1]:
        yield f"its plan lasts {steps.max():.0f} control steps, its recording {arrays['trajectories/skill'].shape[1]}"
