"""Export the policy of an artifact into one ONNX file, which is written only if it answers as the library does."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skillcli.errors import SkillError, StoreError, UsageError
from skillcli.evaluation.library import open_library
from skillcli.execution.policy_ports import Port, Targets, inputs_of, outputs_of
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN
from skillcli.store import ArtifactId, Store, atomic

if TYPE_CHECKING:
    from skillcli.execution.parity import Parity

EXPORTED = (PRETRAIN.name, EMBED_MEANS.name, COMPOSE.name)  # kinds that have a policy
OBSERVATIONS = 1000  # recorded ones, and as many random ones, on which the file is tried
PACKAGES = ("onnx", "onnxruntime")


@dataclass(frozen=True)
class Exported:
    """A written policy file."""

    path: Path
    robot: str  # its name; "" without an arm
    control_period: float  # s
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    parity: Parity


def export_policy(store: Store, artifact_id: ArtifactId, path: Path) -> Exported:
    """Write the policy of an artifact, with normaliser, action limit, targets and metadata, into a new ONNX file.

    Raises:
        UsageError: the artifact has no policy, or the file is there already.
        StoreError: the artifact cannot be read.
        SkillError: the extra packages are missing, the disk refuses, or the file does not answer as the library does.
    """
    if artifact_id.stage not in EXPORTED:
        raise UsageError(f"{artifact_id} has no policy to export", f"give an artifact of kind {', '.join(EXPORTED)}")
    _check_installed()
    path = path.absolute()
    _check_place(path)
    from skillcli.execution.parity import expected, measure_parity
    from skillcli.execution.policy_graph import Weights, build_model
    from skillcli.execution.policy_metadata import describe_policy
    from skillcli.execution.policy_samples import Samples, random_samples, recorded_samples

    artifact = store.read(artifact_id)
    library = open_library(store, artifact)
    world, targets = library.world, Targets.of(library.world)
    inputs, outputs = inputs_of(library, targets), outputs_of(library, targets)
    weights = Weights.of(library.agent, library.mean.shape[1])
    metadata = describe_policy(library, artifact, weights, targets, inputs, outputs)
    model = build_model(weights, world.task.action_scale, targets, inputs, outputs, metadata)
    samples = Samples.join(
        [
            recorded_samples(library, artifact, targets, OBSERVATIONS),
            random_samples(library, weights, targets, OBSERVATIONS),
        ]
    )
    wanted = expected(library, targets, samples)
    parity = _write(path, model.SerializeToString(), lambda written: measure_parity(written, samples, wanted))
    robot = world.robot.name if world.spec.uses_robot else ""
    return Exported(path, robot, world.task.control_period, inputs, outputs, parity)


def _check_installed() -> None:
    for package in PACKAGES:
        try:
            importlib.import_module(package)
        except ImportError as error:
            if error.name not in PACKAGES:
                raise  # it is installed, but does not work: that error says more
            raise SkillError(
                f"--onnx needs the packages {' and '.join(PACKAGES)}, and {package} is not installed",
                "pip install 'skillcli[onnx]'",
            ) from error


def _check_place(path: Path) -> None:
    """Refuse before the work what cannot be written after it."""
    if os.path.lexists(path):
        raise UsageError(f"{path} is there already", "choose another name, or move it away")
    with _refusals():
        atomic.try_writing(path.parent)


def _write(path: Path, data: bytes, check: Callable[[Path], Parity]) -> Parity:
    """Write the file beside its name, check it there, and only then give it its name; else leave nothing."""
    with _refusals():
        return atomic.write_atomically(path, memoryview(data), check)


@contextmanager
def _refusals() -> Iterator[None]:
    """Give advice for a single file where the disk refuses: that of a store names its own option."""
    try:
        yield
    except StoreError as error:
        raise SkillError(error.message, "choose another folder, or free some space") from error
