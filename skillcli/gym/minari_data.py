"""Recorded motion as a data set of Minari, the library of offline data of the makers of Gymnasium."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from skillcli.errors import SkillError, UsageError
from skillcli.evaluation.consistency import stored_recipe
from skillcli.store import Artifact
from skillcli.tasks.world import World
from skillcli.trajectories import AXES, Array, Trajectories

EXTRA = "install it: pip install 'skillcli[minari]'"
STATES = ("joint_position", "gripper_position", "object_pose", "other_poses", "finger_position", "position")
PARTS = {"xyz": ("x", "y", "z"), "xy": ("x", "y"), "pose": ("x", "y", "z", "qw", "qx", "qy", "qz")}


def export_minari(artifact: Artifact, root: Path) -> Path:
    """Write the trajectories of an artifact as the Minari data set of its id below a folder of data sets.

    An observation is a dictionary: every recorded state, `achieved_goal` and `desired_goal`. An action is how far the step
    moved the commanded targets. Infos: latent and skill that were held from each state on, time, success of the episode. The
    last step of an episode is terminated if its simulation diverged, else truncated. The metadata have `fps`, names and units
    of every number, recipe, seed and content hash.

    Args:
        artifact: any with trajectories.
        root: the folder of data sets, as MINARI_DATASETS_PATH names it.

    Returns:
        The folder of the data set, ROOT/NAME/STAGE-vN/data; Minari loads it by the id.

    Raises:
        SkillError: Minari is missing, or the disk refuses.
        UsageError: the artifact has no trajectories, or the data set exists.
    """
    try:
        from minari.dataset.minari_storage import MinariStorage
    except ImportError:
        raise SkillError("--minari needs the package minari", EXTRA) from None
    arrays = artifact.group("trajectories")
    if "time" not in arrays:
        raise UsageError(f"{artifact.id} holds no trajectories", "give one that has, such as a composition")
    recording = Trajectories(**arrays)
    target = root / str(artifact.id) / "data"
    if target.exists():
        raise UsageError(f"{target} exists already", "remove it, or give another folder")
    buffers = [_episode(recording, episode) for episode in range(recording.episodes)]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=root, prefix=".skill-") as scratch:  # nothing half-written under its name
            storage = MinariStorage.new(Path(scratch) / "data", *_spaces(recording), data_format="hdf5")
            storage.update_metadata(_metadata(artifact, recording))
            storage.update_episodes(buffers)
            storage.update_metadata({"dataset_size": float(storage.get_size())})
            (Path(scratch) / "data").rename(target)
    except OSError as error:
        shutil.rmtree(target, ignore_errors=True)
        raise SkillError(f"{target} cannot be written: {error.strerror or error}", "check disk and folder") from None
    return target


def _states(recording: Trajectories) -> dict[str, Array]:
    """Return the recorded states by name, (E, T+1, n) each."""
    present = recording.arrays()
    desired = np.repeat(recording.target[:, None], len(recording.time), axis=1)
    states = {name: present[name] for name in STATES if name in present}
    return {**states, "achieved_goal": recording.achieved_goal, "desired_goal": desired}


def _spaces(recording: Trajectories) -> tuple[spaces.Dict, spaces.Box]:
    def unbounded(array: Array) -> spaces.Box:
        return spaces.Box(-np.inf, np.inf, array.shape[2:], array.dtype.type)

    return spaces.Dict({name: unbounded(array) for name, array in _states(recording).items()}), unbounded(recording.action)


def _episode(recording: Trajectories, episode: int) -> Any:
    from minari.data_collector.episode_buffer import EpisodeBuffer

    steps = int(recording.length[episode])
    rows = np.minimum(np.arange(steps + 1), steps - 1)  # the last state holds what led to it
    diverged, last = bool(~recording.stable[episode]), np.arange(steps) == steps - 1
    return EpisodeBuffer(
        observations={name: array[episode, : steps + 1] for name, array in _states(recording).items()},
        actions=recording.action[episode, :steps],
        rewards=recording.reward[episode, :steps],
        terminations=last & diverged,
        truncations=last & (not diverged),
        infos={
            "latent": recording.latent[episode, rows],
            "skill": recording.skill[episode, rows],
            "success": np.full(steps + 1, recording.success[episode]),
            "time": recording.time[: steps + 1],
        },
    )


def _metadata(artifact: Artifact, recording: Trajectories) -> dict[str, Any]:
    world = World.of(stored_recipe(artifact))
    joints = list(world.robot.description.joints) if world.spec.uses_robot else []
    units = {"achieved_goal": "m", "desired_goal": "m"}
    fields = {}
    for name, array in _states(recording).items():
        kind = "xyz" if name in units else AXES[name][0].split(",")[-1]
        fields[name] = {
            "unit": units.get(name) or AXES[name][1],
            "names": list(PARTS.get(kind, joints)),
            "size": array.shape[2],
        }
    unit = "rad" if world.spec.uses_robot else "m"
    fields["action"] = {"unit": unit, "names": joints or ["x", "y"], "size": recording.action.shape[2]}
    return {
        "dataset_id": str(artifact.id),
        "algorithm_name": f"skill {artifact.kind}",
        "description": f"{recording.episodes} episodes of the {world.task.name} task; positions in the frame of the base",
        "requirements": [f"{name}=={artifact.packages[name]}" for name in ("mujoco", "numpy") if name in artifact.packages],
        "minari_version": _minari_version(),
        "fps": 1.0 / float(world.task.control_period),
        "fields": fields,
        "robot": world.robot.name if world.spec.uses_robot else "",
        "recipe": artifact.recipe_name,
        "seed": artifact.seed,
        "content_sha256": artifact.content_sha256,
    }


def _minari_version() -> str:
    from importlib.metadata import version

    return version("minari")
