"""Export the policy of an artifact into one ONNX file, which is written only if it answers as the library does."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skillcli.errors import SkillError, UsageError
from skillcli.evaluation.library import open_library
from skillcli.execution.policy_ports import Port, Targets, inputs_of, outputs_of
from skillcli.files import replacing
from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN
from skillcli.store import ArtifactId, Store

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
    """Write the policy of an artifact, with normaliser, action limit, targets and metadata, into an ONNX file.

    Raises:
        UsageError: the artifact has no policy, or one that moves fingers.
        StoreError: the artifact cannot be read.
        SkillError: the extra packages are missing, the disk refuses, or the file does not answer as the library does; a file
            that was there is unchanged.
    """
    if artifact_id.stage not in EXPORTED:
        raise UsageError(f"{artifact_id} has no policy to export", f"give an artifact of kind {', '.join(EXPORTED)}")
    _check_installed()
    from skillcli.execution.parity import expected, measure_parity
    from skillcli.execution.policy_graph import Weights, build_model
    from skillcli.execution.policy_metadata import describe_policy
    from skillcli.execution.policy_samples import Samples, random_samples, recorded_samples

    with replacing(path) as (temporary,):
        artifact = store.read(artifact_id)
        library = open_library(store, artifact)
        if library.world.spec.grasps:
            raise UsageError(
                f"the {library.recipe.task.name} task moves the fingers of a hand, and exported policies command joints only",
                "give a library of another task",
            )
        world, targets = library.world, Targets.of(library.world)
        inputs, outputs = inputs_of(library, targets), outputs_of(library, targets)
        weights = Weights.of(library.agent, library.mean.shape[1])
        metadata = describe_policy(library, artifact, weights, targets, inputs, outputs)
        model = build_model(weights, world.task.action_scale, targets, inputs, outputs, metadata)
        temporary.write_bytes(model.SerializeToString())
        recorded = recorded_samples(library, artifact, targets, OBSERVATIONS)
        samples = Samples.join([recorded, random_samples(library, weights, targets, OBSERVATIONS)])
        parity = measure_parity(temporary, samples, expected(library, targets, samples))
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
